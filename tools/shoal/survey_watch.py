"""What happens in a survey, as the base's host sees it: who was missed, who took whose cells."""

from __future__ import annotations

from procboard.survey.mission import Mission
from procboard.survey.plan import Shares
from tools.records.survey_data import BASE, Cell, Happening, SurveyEvent


class SurveyWatch:
    """Notes what has changed in a mission since it was looked at last."""

    def __init__(self, mission: Mission) -> None:
        self.events: list[SurveyEvent] = []
        self._mission = mission
        self._plan: Shares = {}
        self._missed: set[int] = set()
        self._not_reached: set[tuple[Cell, int]] = set()
        self._given_up: set[Cell] = set()

    def look(self, now_s: float) -> None:
        """See what is new. Called whenever the mission has learnt something."""
        knowledge = self._mission.knowledge
        for robot in sorted(knowledge.latest):
            if knowledge.lives(robot) == (robot not in self._missed):
                continue
            if robot in self._missed:
                self._missed.remove(robot)
                self._note(now_s, Happening.RETURNED, robot)
                continue
            self._missed.add(robot)
            self._note(now_s, Happening.MISSED, robot)
            share = self._plan.get(robot, ())
            left = tuple(cell for cell in share if cell not in knowledge.samples)
            if left:
                self._note(now_s, Happening.TAKEN_OVER, robot, left)
        skips = {(cell, robot) for cell, who in knowledge.skips.items() for robot in who}
        for cell, robot in sorted(skips - self._not_reached):
            self._note(now_s, Happening.NOT_REACHED, robot, (cell,))
        given_up = set(knowledge.given_up())
        for cell in sorted(given_up - self._given_up):
            self._note(now_s, Happening.GIVEN_UP, cells=(cell,))
        self._not_reached, self._given_up, self._plan = skips, given_up, self._mission.plan

    def complete(self, now_s: float) -> None:
        """All that live know the field."""
        self._note(now_s, Happening.COMPLETE)

    def _note(
        self, now_s: float, what: Happening, robot: int = BASE, cells: tuple[Cell, ...] = ()
    ) -> None:
        self.events.append(SurveyEvent(now_s, what, robot, cells))
