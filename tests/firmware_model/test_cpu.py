"""The CPU model: latencies to the cycle, preemption, sleep, and the shortcut through time."""

from __future__ import annotations

from collections.abc import Generator
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_model.cpu import Coroutine, Cpu, CpuTiming, Flag
from firmware_model.errors import FirmwareError
from firmware_model.interrupts import DspicInterrupts, DspicSource, Msp430Interrupts
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S, FS_PER_US, Clock

US = FS_PER_US
ENTRY, EXIT, SWITCH = 5, 3, 2
WAKE_FS = 6 * US
TIMING = CpuTiming(ENTRY, EXIT, SWITCH, {"deep": WAKE_FS})
NAMES = ("low", "mid", "high")


class Board:
    """A CPU at 1 MHz (a cycle is a microsecond) with three nesting interrupt sources."""

    def __init__(self, scheduler: Scheduler | None = None, sleep_state: str = "idle") -> None:
        self.scheduler = scheduler or Scheduler()
        self.interrupts = DspicInterrupts([DspicSource(n, 4 * i) for i, n in enumerate(NAMES)])
        self.interrupts.bank["IEC0"].write(0xFFFF)
        for i in range(3):
            self.interrupts.bank[f"IPC{i}"].write(2 * i + 1)  # low 1, mid 3, high 5
        self.rail = Rail(self.scheduler, "vcc", 3.0)
        self.consumer = self.rail.consumer(
            "cpu", {"active": 2e-3, "idle": 1e-3, "deep": 1e-6, "reset": 0.0}
        )
        self.cpu = Cpu(
            "cpu", self.scheduler, Clock(1_000_000), self.interrupts, TIMING, self.consumer,
            sleep_state,
        )  # fmt: skip
        self.log: list[tuple[float, str]] = []

    def note(self, what: str) -> None:
        self.log.append((self.scheduler.now / US, what))

    def request(self, at_us: float, name: str) -> None:
        self.scheduler.at(round(at_us * US), self.interrupts.line(name).request)

    def handler(self, name: str, cycles: int) -> None:
        def handle() -> int:
            self.note(name)
            self.interrupts.line(name).clear()
            return cycles

        self.cpu.on_interrupt(name, handle)

    def stepped_handler(self, name: str, *pieces: int) -> None:
        def handle() -> Generator[int, None, None]:
            self.interrupts.line(name).clear()
            for number, cycles in enumerate(pieces):
                self.note(f"{name}{number}")
                yield cycles
            self.note(f"{name} end")

        self.cpu.on_interrupt(name, handle)

    def task(self, name: str, *pieces: int) -> None:
        def body() -> Coroutine:
            for number, cycles in enumerate(pieces):
                self.note(f"{name}{number}")
                yield cycles
            self.note(f"{name} end")

        self.cpu.spawn(name, body())


def test_a_task_pays_after_it_acts() -> None:
    board = Board()
    board.task("t", 10, 20)
    board.cpu.start()
    board.scheduler.run(FS_PER_MS)
    # The first cycle after release is number 1; the switch costs 2.
    assert board.log == [(3, "t0"), (13, "t1"), (33, "t end")]
    assert board.cpu.busy_cycles == SWITCH + 30


def test_tasks_take_turns_in_order_only_when_they_wait() -> None:
    board = Board()
    gate = Flag("gate")

    def waiter() -> Coroutine:
        board.note("wait")
        yield gate
        board.note("woken")

    board.cpu.spawn("w", waiter())
    board.task("a", 10)
    board.task("b", 10)
    board.cpu.start()
    board.scheduler.at(5 * US, gate.set)
    board.scheduler.run(FS_PER_MS)
    assert [what for _, what in board.log] == ["wait", "a0", "a end", "b0", "b end", "woken"]


def test_interrupt_latency_from_a_running_task() -> None:
    board = Board()
    board.task("t", 100, 10)
    board.handler("low", 7)
    board.request(20.5, "low")
    board.cpu.start()
    board.scheduler.run(FS_PER_MS)
    # Taken at the cycle boundary 21, entered after 5 cycles; the task still owes 103 − 21.
    finished = 21 + ENTRY + 7 + EXIT + (103 - 21)
    assert board.log == [(3, "t0"), (26, "low"), (finished, "t1"), (finished + 10, "t end")]
    assert board.cpu.busy_cycles == SWITCH + 100 + 10 + ENTRY + 7 + EXIT


def test_interrupt_latency_from_sleep() -> None:
    board = Board(sleep_state="deep")
    board.handler("low", 7)
    board.cpu.start()
    board.request(100.25, "low")
    board.scheduler.run(FS_PER_MS)
    # Awake 6 µs later, at the next edge; then five cycles of entry.
    assert board.log == [(107 + ENTRY, "low")]
    assert board.cpu.busy_cycles == ENTRY + 7 + EXIT


def test_a_flag_from_outside_wakes_a_task_from_sleep() -> None:
    board = Board(sleep_state="deep")
    gate = Flag("gate")

    def body() -> Coroutine:
        while True:
            yield gate
            board.note("woken")
            yield 10

    board.cpu.spawn("t", body())
    board.cpu.start()
    board.scheduler.at(200 * US, gate.set)
    board.scheduler.run(FS_PER_MS)
    assert board.log == [(200 + 6 + 1 + SWITCH, "woken")]


def test_a_set_flag_does_not_make_its_waiter_wait() -> None:
    board = Board()
    gate = Flag("gate")
    gate.set()

    def body() -> Coroutine:
        yield gate
        board.note("first")
        yield gate
        board.note("never")

    board.cpu.spawn("t", body())
    board.cpu.start()
    board.scheduler.run(FS_PER_MS)
    assert [what for _, what in board.log] == ["first"]
    assert not gate.is_set


def test_a_flag_wakes_all_waiters_in_their_order_and_clear_forgets() -> None:
    board = Board()
    gate = Flag("gate")

    def body(name: str) -> Coroutine:
        yield gate
        board.note(name)

    for name in "abc":
        board.cpu.spawn(name, body(name))
    board.cpu.start()
    board.scheduler.run(50 * US)
    gate.set()
    gate.set()
    gate.clear()
    board.scheduler.run(FS_PER_MS)
    assert [what for _, what in board.log] == ["a", "b", "c"]
    assert not gate.is_set


def test_higher_levels_nest_and_equal_ones_wait() -> None:
    board = Board()
    board.stepped_handler("low", 20, 20)
    board.stepped_handler("high", 10)
    board.handler("mid", 4)
    board.task("t", 200)
    board.request(10, "low")
    board.request(30, "high")
    board.request(31, "mid")
    board.cpu.start()
    board.scheduler.run(FS_PER_MS)
    assert [what for _, what in board.log] == [
        "t0", "low0", "high0", "high end", "mid", "low1", "low end", "t end"
    ]  # fmt: skip
    work = 200 + 40 + 10 + 4
    assert board.cpu.busy_cycles == SWITCH + work + 3 * (ENTRY + EXIT)
    assert board.log[-1][0] == 1 + board.cpu.busy_cycles


def test_a_request_from_before_the_start_is_taken() -> None:
    board = Board()
    board.handler("low", 4)
    board.interrupts.line("low").request()  # as set-up code may cause
    board.cpu.start()
    board.scheduler.run(FS_PER_MS)
    assert board.log == [(1 + ENTRY, "low")]


def test_the_highest_request_at_the_end_of_entry_wins() -> None:
    board = Board()
    board.handler("low", 4)
    board.handler("high", 4)
    board.task("t", 100)
    board.request(10, "low")
    board.request(13, "high")  # during the entry that "low" began
    board.cpu.start()
    board.scheduler.run(FS_PER_MS)
    assert [what for _, what in board.log] == ["t0", "high", "low", "t end"]


def test_a_request_withdrawn_during_entry_is_no_interrupt() -> None:
    board = Board()
    board.handler("low", 4)
    board.task("t", 100)
    board.request(10, "low")
    board.scheduler.at(12 * US, board.interrupts.line("low").clear)
    board.cpu.start()
    board.scheduler.run(FS_PER_MS)
    assert [what for _, what in board.log] == ["t0", "t end"]
    assert board.cpu.interrupts_taken == 0
    assert board.cpu.busy_cycles == SWITCH + 100 + ENTRY


def test_msp430_handlers_do_not_nest() -> None:
    scheduler = Scheduler()
    controller = Msp430Interrupts()
    one, two = controller.line("one", 3), controller.line("two", 9)
    consumer = Rail(scheduler, "vcc", 3.0).consumer("cpu", {"active": 1.0, "idle": 0.0})
    cpu = Cpu("cpu", scheduler, Clock(1_000_000), controller, TIMING, consumer, "idle")
    log: list[str] = []

    def first() -> Generator[int, None, None]:
        one.clear()
        log.append("one")
        yield 50
        log.append("one end")

    def second() -> int:
        two.clear()
        log.append("two")
        return 1

    cpu.on_interrupt("one", first)
    cpu.on_interrupt("two", second)
    cpu.start()
    controller.gie = True
    scheduler.at(10 * US, one.request)
    scheduler.at(30 * US, two.request)
    scheduler.run(FS_PER_MS)
    assert log == ["one", "one end", "two"]


def test_energy_follows_running_and_sleeping() -> None:
    board = Board()
    board.handler("low", 92)
    board.cpu.start()
    for ms in range(1, 10):
        board.request(1_000 * ms, "low")
    board.scheduler.run(10 * FS_PER_MS)
    table = board.consumer.table()
    busy_s = 9 * 101 * 1e-6  # to the next edge (1), entry 5, 92, exit 3
    assert table["active"][0] == pytest.approx(busy_s + 1e-6)  # and the first cycle after reset
    assert table["idle"][0] == pytest.approx(10e-3 - busy_s - 1e-6)
    assert table["active"][1] == pytest.approx(table["active"][0] * 2e-3 * 3.0)


def test_sleep_hooks_see_each_sleep_and_each_wake_up() -> None:
    board = Board()
    calls: list[tuple[float, str]] = []
    board.cpu.on_sleep = lambda state: calls.append((board.scheduler.now / US, state))
    board.cpu.on_wake = lambda: calls.append((board.scheduler.now / US, "wake"))
    board.handler("low", 2)
    board.cpu.start()
    board.request(50, "low")
    board.scheduler.run(FS_PER_MS)
    slept_again = 51 + ENTRY + 2 + EXIT
    assert calls == [(1, "idle"), (50, "wake"), (slept_again, "idle")]


def test_held_cycles_delay_what_runs_and_cost_nothing_asleep() -> None:
    board = Board()
    board.task("t", 100, 10)
    board.cpu.start()
    board.scheduler.at(50 * US, lambda: board.cpu.hold(8))
    board.scheduler.run(500 * US)
    board.cpu.hold(1_000)  # asleep: nobody to hold
    board.scheduler.run(FS_PER_MS)
    assert board.log == [(3, "t0"), (103 + 8, "t1"), (103 + 8 + 10, "t end")]
    assert board.cpu.busy_cycles == SWITCH + 110 + 8


@pytest.mark.parametrize("stepped", [False, True])
def test_cycles_held_by_the_code_itself_are_paid_by_it(stepped: bool) -> None:
    board = Board()

    def atomic() -> int:
        board.interrupts.line("low").clear()
        board.note("low")
        board.cpu.hold(30)
        return 4

    def steps() -> Generator[int, None, None]:
        atomic()
        yield 4

    board.cpu.on_interrupt("low", steps if stepped else atomic)
    board.handler("mid", 1)
    board.cpu.start()
    board.request(50, "low")
    board.scheduler.run(FS_PER_MS)
    assert board.cpu.busy_cycles == ENTRY + 30 + 4 + EXIT


def test_halting_ends_every_coroutine_and_boot_starts_afresh() -> None:
    board = Board()
    closed: list[str] = []

    def body() -> Coroutine:
        try:
            while True:
                yield 100
        finally:
            closed.append("task")

    def handle() -> Generator[int, None, None]:
        try:
            yield 1_000
        finally:
            closed.append("handler")

    board.cpu.spawn("t", body())
    board.cpu.on_interrupt("low", handle)
    gate = Flag("gate")

    def waiter() -> Coroutine:
        yield gate
        closed.append("must not run")

    board.cpu.spawn("w", waiter())
    board.cpu.start()
    board.request(50, "low")
    board.scheduler.run(100 * US)
    board.cpu.halt("reset")
    assert sorted(closed) == ["handler", "task"]
    assert board.consumer.state == "reset"
    gate.set()  # a waiter from before the reset does not come back
    board.interrupts.line("low").request()
    board.scheduler.run(200 * US)
    assert not board.cpu.running
    board.interrupts.bank["IFS0"].write(0)  # what came during the reset is forgotten
    board.interrupts.bank["IEC0"].write(0xFFFF)
    board.task("new", 1)
    board.cpu.start()
    board.scheduler.run(FS_PER_MS)
    assert [what for _, what in board.log] == ["new0", "new end"]


def test_a_cpu_cannot_be_halted_from_inside() -> None:
    board = Board()

    def body() -> Coroutine:
        board.cpu.halt()
        yield 1

    board.cpu.spawn("t", body())
    board.cpu.start()
    with pytest.raises(FirmwareError, match="own firmware"):
        board.scheduler.run(FS_PER_MS)


def failing_task(what: object) -> Board:
    board = Board()

    def body() -> Generator[object, None, None]:
        yield what

    board.cpu.spawn("t", body())  # type: ignore[arg-type]
    board.cpu.start()
    return board


@pytest.mark.parametrize(("what", "message"), [(-1, "-1 cycles"), ("x", "'x'"), (1.5, "1.5")])
def test_yielding_nonsense_is_an_error(what: object, message: str) -> None:
    with pytest.raises(FirmwareError, match=message):
        failing_task(what).scheduler.run(FS_PER_MS)


def test_an_interrupt_without_a_handler_is_an_error() -> None:
    board = Board()
    board.cpu.start()
    board.request(10, "mid")
    with pytest.raises(FirmwareError, match="mid has no handler"):
        board.scheduler.run(FS_PER_MS)


def test_a_handler_must_not_wait() -> None:
    board = Board()

    def handle() -> Generator[object, None, None]:
        yield Flag("gate")

    board.cpu.on_interrupt("low", handle)  # type: ignore[arg-type]
    board.cpu.start()
    board.request(10, "low")
    with pytest.raises(FirmwareError, match="waited for gate"):
        board.scheduler.run(FS_PER_MS)


class NoShortcut(Scheduler):
    """A scheduler on which every passage of time goes through the heap."""

    __slots__ = ()

    def advance(self, time_fs: int) -> bool:
        return False


def random_firmware(board: Board, seed: int) -> None:
    """Spawn tasks and handlers that charge, wait, signal, hold and request at random."""
    random = Random(seed)
    flags = [Flag(f"f{n}") for n in range(3)]

    def body(name: str, own: Random) -> Coroutine:
        for step in range(40):
            board.note(f"{name}.{step}")
            choice = own.random()
            if choice < 0.5:
                yield own.randrange(60)
            elif choice < 0.7:
                yield own.choice(flags)
            elif choice < 0.85:
                own.choice(flags).set()
                yield own.randrange(5)
            elif choice < 0.95:
                board.interrupts.line(own.choice(NAMES)).request()
                yield 3
            else:
                board.cpu.hold(own.randrange(9))
                yield 1

    def stepped(name: str, own: Random) -> Generator[int, None, None]:
        board.interrupts.line(name).clear()
        for step in range(own.randrange(4)):
            board.note(f"{name}/{step}")
            yield own.randrange(30)
            if own.random() < 0.2:
                own.choice(flags).set()

    def install(name: str, own: Random) -> None:
        def handle() -> int | Generator[int, None, None]:
            if own.random() < 0.5:
                return stepped(name, own)
            board.note(name)
            board.interrupts.line(name).clear()
            own.choice(flags).set()
            return own.randrange(40)

        board.cpu.on_interrupt(name, handle)

    for name in NAMES:
        install(name, Random(random.random()))
    for n in range(4):
        board.cpu.spawn(f"t{n}", body(f"t{n}", Random(random.random())))
    for _ in range(60):
        at_us = random.choice([random.uniform(0, 4_000), random.randrange(4_000)])
        board.request(at_us, random.choice(NAMES))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(["idle", "deep"]))
def test_the_shortcut_through_time_changes_nothing(seed: int, sleep_state: str) -> None:
    results = []
    for scheduler in (Scheduler(), NoShortcut()):
        board = Board(scheduler, sleep_state)
        random_firmware(board, seed)
        board.cpu.start()
        # Runs of uneven length: where a run ends must not matter either.
        end = 0
        pieces = Random(seed if isinstance(scheduler, NoShortcut) else ~seed)
        while end < 6 * FS_PER_MS:
            end += pieces.randrange(1, FS_PER_MS)
            scheduler.run(end)
        scheduler.run(FS_PER_S)
        results.append(
            (
                board.log,
                board.cpu.busy_cycles,
                board.cpu.interrupts_taken,
                {state: row[0] for state, row in board.consumer.table().items()},
            )
        )
    assert results[0] == results[1]
    assert len(results[0][0]) > 40


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.integers(0, 200), min_size=1, max_size=8),
    st.lists(
        st.tuples(st.floats(0, 1_500), st.sampled_from(NAMES), st.integers(0, 50)), max_size=12
    ),
)
def test_busy_cycles_are_conserved(
    pieces: list[int], requests: list[tuple[float, str, int]]
) -> None:
    board = Board()
    charged = [SWITCH]

    def install(name: str) -> None:
        def handle() -> int:
            board.interrupts.line(name).clear()
            charged.append(ENTRY + 11 + EXIT)
            return 11

        board.cpu.on_interrupt(name, handle)

    for name in NAMES:
        install(name)
    board.task("t", *pieces)
    charged += pieces
    for at_us, name, _ in requests:
        board.request(at_us, name)
    board.cpu.start()
    board.scheduler.run(FS_PER_S)
    assert board.cpu.busy_cycles == sum(charged)
