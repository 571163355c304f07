"""What docs/network.md says of emulated boards, measured: `python -m` this; half a minute."""

from __future__ import annotations

from random import Random

from tests.procboard.routing.emulated import Shoal, in_a_row

SEEDS = (1, 2, 3)


def time_error(boards: int, loss: float, seed: int) -> tuple[int, int]:
    """Largest difference [ticks] between any two boards in 300 s, and stamps that were late."""
    random = Random(seed)
    drifts = tuple(random.uniform(-50, 50) for _ in range(boards))
    shoal = Shoal(in_a_row(boards), loss=loss, seed=seed, drifts=drifts)
    shoal.run(240 + 30 * boards)
    worst = 0
    for _ in range(300):
        shoal.run(1.0)
        times = [mote.routing.global_ticks() for mote in shoal.motes]
        known = [ticks for ticks in times if ticks is not None]
        assert len(known) == boards
        worst = max(worst, max(known) - min(known))
    late = sum(m.app.services.network.statistics.late_stamps for m in shoal.motes)
    return worst, late


def main() -> None:
    """Print the figures."""
    for boards in (2, 4, 7):
        for loss in (0.0, 0.3):
            runs = [time_error(boards, loss, seed) for seed in SEEDS]
            print(f"{boards - 1} hops, {loss:.0%} lost: ticks, late stamps: {runs}", flush=True)


if __name__ == "__main__":
    main()
