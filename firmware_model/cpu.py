"""A CPU that runs firmware written in Python: tasks and handlers that cost cycles.

Firmware is coroutines. A task yields an integer to charge that many cycles for the code it has
just executed, or a `Flag` to wait for; a handler returns its cycles, or is itself a coroutine that
yields cycles. Between yields code is atomic: its effects happen at the start of the cycles that it
charges. Interrupts of a higher level preempt at cycle boundaries; what a preempted context still
owes is kept and paid when it resumes. With nothing to run the CPU sleeps in the state that
firmware chose, and an interrupt wakes it after that state's latency.

A CPU that is alone until its next cycle boundary moves time itself (`Scheduler.advance`) instead of
going through the event heap. The outcome is the same; it is what makes whole robots run many times
faster than real time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

from firmware_model.errors import FirmwareError
from firmware_model.interrupts import InterruptController
from firmware_model.power import Consumer
from firmware_model.scheduler import Event, Priority, Scheduler
from firmware_model.time import Clock

_CPU = int(Priority.CPU)


class Flag:
    """What a task waits for. `set` wakes every waiter; with none, the next wait goes on at once."""

    __slots__ = ("_waiters", "is_set", "name")

    def __init__(self, name: str) -> None:
        self.name = name
        self.is_set = False
        self._waiters: list[Task] = []

    def set(self) -> None:
        """Wake the waiters, in the order in which they came."""
        waiters = self._waiters
        if waiters:
            self._waiters = []
            for task in waiters:
                task.wake()
        else:
            self.is_set = True

    def clear(self) -> None:
        """Forget an unused `set`."""
        self.is_set = False

    def _wait(self, task: Task) -> bool:
        """Consume the flag and return True, or queue the task and return False."""
        if self.is_set:
            self.is_set = False
            return True
        self._waiters.append(task)
        return False


Coroutine: TypeAlias = Generator[int | Flag, None, None]
Handler: TypeAlias = Callable[[], "int | Generator[int, None, None]"]


class Task:
    """A cooperative thread of firmware at base level."""

    __slots__ = ("_cpu", "alive", "generator", "name", "owed")

    def __init__(self, cpu: Cpu, name: str, generator: Coroutine) -> None:
        self._cpu = cpu
        self.name = name
        self.generator = generator
        self.owed = 0
        self.alive = True

    def wake(self) -> None:
        """Make the task ready; nothing if its CPU was reset since."""
        if self.alive:
            self._cpu._make_ready(self)


class _Handler:
    """An interrupt handler in progress."""

    __slots__ = ("generator", "name", "owed")

    def __init__(self, name: str, generator: Generator[int, None, None] | None, owed: int) -> None:
        self.name = name
        self.generator = generator
        self.owed = owed


_Context: TypeAlias = "Task | _Handler"
_NOTHING: tuple[_Context | None, int] = (None, 0)  # what an interrupt of a sleeping CPU stops


@dataclass(frozen=True, slots=True)
class CpuTiming:
    """Cycles and latencies that the core itself costs; each user cites its datasheet."""

    interrupt_entry_cycles: int
    interrupt_exit_cycles: int
    task_switch_cycles: int
    wake_fs: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Latency from a wake-up request to the first cycle, by sleep state."""


class Cpu:
    """Runs tasks and handlers of one MCU. Starts held in reset; `start` lets it go."""

    ACTIVE = "active"

    def __init__(
        self,
        name: str,
        scheduler: Scheduler,
        clock: Clock,
        interrupts: InterruptController,
        timing: CpuTiming,
        consumer: Consumer,
        sleep_state: str,
    ) -> None:
        self.name = name
        self.scheduler = scheduler
        self.clock = clock
        self.interrupts = interrupts
        self.timing = timing
        self.sleep_state = sleep_state
        self.busy_cycles = 0
        self.interrupts_taken = 0
        self.last_sleep_fs = 0
        """When the CPU last went to sleep: a watchdog is cleared by that."""
        self.running = False
        self._consumer = consumer
        self._entry_cycles = timing.interrupt_entry_cycles
        self._exit_cycles = timing.interrupt_exit_cycles
        self._wake_fs = dict(timing.wake_fs)
        self._handlers: dict[str, Handler] = {}
        self._ready: deque[Task] = deque()
        self._tasks: list[Task] = []
        self._context: _Context | None = None
        self._stack: list[tuple[_Context | None, int]] = []
        self._level = 0
        self._cycle = 0  # the cycle at which the current context continues
        self._event: Event | None = None
        self._executing = False
        self._entering = False
        self._asleep = False
        self._check = False
        self._held = 0  # cycles taken by others from the code that is executing
        self.on_sleep: Callable[[str], None] | None = None
        self.on_wake: Callable[[], None] | None = None
        interrupts.notify = self._notify

    # --- what firmware and boards use -------------------------------------------------

    def on_interrupt(self, name: str, handler: Handler) -> None:
        """Install a handler for the interrupt line of that name."""
        self._handlers[name] = handler

    def spawn(self, name: str, generator: Coroutine) -> Task:
        """Add a task; it runs when its turn comes."""
        task = Task(self, name, generator)
        self._tasks.append(task)
        self._make_ready(task)
        return task

    def start(self) -> None:
        """Leave reset: run what is ready, or sleep."""
        self.running = True
        self._check = True  # a request may have come while firmware set itself up
        self._cycle = self.clock.ticks(self.scheduler.now) + 1
        self._consumer.enter(self.ACTIVE)
        self._asleep = False
        self._event = self.scheduler.at(self.clock.edge(self._cycle), self._continue, _CPU)

    def halt(self, state: str = "off") -> None:
        """Enter reset: every task and handler is gone, as after a loss of RAM contents."""
        if self._executing:
            raise FirmwareError(f"{self.name}: a CPU cannot be halted from its own firmware")
        self.running = False
        self.scheduler.cancel(self._event)
        self._event = None
        for task in self._tasks:
            task.alive = False
            task.generator.close()
        for context, _level in [*self._stack, (self._context, 0)]:
            if isinstance(context, _Handler) and context.generator is not None:
                context.generator.close()
        self._tasks.clear()
        self._ready.clear()
        self._handlers.clear()
        self._stack.clear()
        self._context = None
        self._level = 0
        self._entering = self._asleep = self._check = False
        self.interrupts.reset()
        self._consumer.enter(state)

    def hold(self, cycles: int) -> None:
        """Take bus cycles from whatever runs now (DMA, flash programming); free if asleep."""
        if self._executing:
            self._held += cycles
        elif self._context is not None:
            self._context.owed += cycles

    @property
    def asleep(self) -> bool:
        """Whether the CPU sleeps in `sleep_state`, with nothing to run."""
        return self._asleep

    @property
    def executing(self) -> bool:
        """Whether firmware is on the stack: then a reset must wait for an event of its own."""
        return self._executing

    @property
    def level(self) -> int:
        """Interrupt level of what is running: 0 for tasks."""
        return self._level

    # --- waking and preempting --------------------------------------------------------

    def _make_ready(self, task: Task) -> None:
        self._ready.append(task)
        if self._asleep:
            self._wake(0)

    def _notify(self) -> None:
        """Look at the requests: the interrupt controller saw one become acceptable."""
        if not self.running:
            return
        if self._executing:
            self._check = True
        elif not self._entering and self.interrupts.next(self._level) is not None:
            self._entering = True
            if self._asleep:
                self._stack.append(_NOTHING)
                self._wake(self._entry_cycles)
            else:
                self._suspend()

    def _wake(self, entry_cycles: int) -> None:
        self._asleep = False
        if self.on_wake is not None:
            self.on_wake()
        self._consumer.enter(self.ACTIVE)
        scheduler, clock = self.scheduler, self.clock
        awake_fs = scheduler.now + self._wake_fs.get(self.sleep_state, 0)
        self._cycle = cycle = clock.ticks(awake_fs) + 1 + entry_cycles
        action = self._enter if entry_cycles else self._continue
        self._event = scheduler.at(clock.edge(cycle), action, _CPU)

    def _suspend(self) -> None:
        """Stop paying for the current context at the next cycle and begin interrupt entry."""
        self.scheduler.cancel(self._event)
        boundary = self.clock.ticks(self.scheduler.now) + 1
        context = self._context
        if context is None:  # still waking up
            boundary = max(boundary, self._cycle)
        else:
            unpaid = max(0, self._cycle - boundary)
            context.owed += unpaid
            self.busy_cycles -= unpaid
        self._stack.append((context, self._level))
        self._cycle = boundary + self._entry_cycles
        self._event = self.scheduler.at(self.clock.edge(self._cycle), self._enter, _CPU)

    def _enter(self) -> None:
        """Fetch the vector: the highest request at this cycle is taken."""
        self._entering = False
        self.busy_cycles += self._entry_cycles
        interrupts = self.interrupts
        line = interrupts.next(self._stack[-1][1])
        if line is None:  # withdrawn during entry
            self._context, self._level = self._stack.pop()
            self._continue()
            return
        handler = self._handlers.get(line.name)
        if handler is None:
            raise FirmwareError(f"{self.name}: interrupt {line.name} has no handler")
        interrupts.accept(line)
        self.interrupts_taken += 1
        self._level = line.priority
        self._executing = True
        result = handler()
        self._executing = False
        owed = self._held
        if owed:
            self._held = 0
        if isinstance(result, int):
            self._run_atomic(line.name, owed + result + self._exit_cycles)
        else:
            self._context = _Handler(line.name, result, owed)
            self._continue()

    def _run_atomic(self, name: str, owed: int) -> None:
        """Pay for an atomic handler, leave it and go on.

        What `_continue` would do step by step, for the common case that nothing else happens
        until the handler is over.
        """
        cycle = self._cycle + owed
        if self._check or not self.scheduler.advance(self.clock.edge(cycle)):
            self._context = _Handler(name, None, owed)
            self._continue()
            return
        self._cycle = cycle
        self.busy_cycles += owed
        context, self._level = self._stack.pop()
        self._context = context
        if context is None and not self._ready and self.interrupts.next(0) is None:
            self._event = None
            self._sleep()
        else:
            self._check = True
            self._continue()

    # --- running ----------------------------------------------------------------------

    def _continue(self) -> None:
        """Run from the current cycle until time must pass for others, or nothing is left."""
        self._event = None
        scheduler, clock = self.scheduler, self.clock
        while True:
            if self._check:
                self._check = False
                if self.interrupts.next(self._level) is not None:
                    self._stack.append((self._context, self._level))
                    self._cycle += self._entry_cycles
                    self._entering = True
                    self._event = scheduler.at(clock.edge(self._cycle), self._enter, _CPU)
                    return
            context = self._context
            if context is None:
                if not self._next_task():
                    return
            elif context.owed:
                cycles, context.owed = context.owed, 0
                self._cycle += cycles
                self.busy_cycles += cycles
                due = clock.edge(self._cycle)
                if not scheduler.advance(due):
                    self._event = scheduler.at(due, self._continue, _CPU)
                    return
            elif context.generator is None:
                self._leave_handler()
            elif self._step(context):
                return

    def _next_task(self) -> bool:
        if self._ready:
            self._context = task = self._ready.popleft()
            task.owed += self.timing.task_switch_cycles
            return True
        self._sleep()
        return False

    def _sleep(self) -> None:
        self._asleep = True
        self.last_sleep_fs = self.scheduler.now
        self._consumer.enter(self.sleep_state)
        if self.on_sleep is not None:
            self.on_sleep(self.sleep_state)

    def _leave_handler(self) -> None:
        self._context, self._level = self._stack.pop()
        self._check = True

    def _step(self, context: _Context) -> bool:
        """Execute a coroutine up to a yield after which `_continue` has to look around.

        Return whether the CPU waits instead, since others are due before its cycles are over.
        """
        generator = context.generator
        assert generator is not None
        scheduler, edge = self.scheduler, self.clock.edge
        advance = scheduler.advance
        self._executing = True
        try:
            # Plain cycles in which nothing else happens are paid without leaving this loop.
            while True:
                item = next(generator)
                if type(item) is not int or item <= 0:
                    break
                if self._check or self._held:
                    break
                self._cycle = cycle = self._cycle + item
                self.busy_cycles += item
                due = edge(cycle)
                if not advance(due):
                    self._event = scheduler.at(due, self._continue, _CPU)
                    return True
        except StopIteration:
            if isinstance(context, Task):
                context.alive = False
                self._tasks.remove(context)
                self._context = None
            else:
                context.generator = None
                context.owed += self._exit_cycles
            return False
        finally:
            self._executing = False
            if self._held:
                context.owed += self._held
                self._held = 0
        if type(item) is int:
            if item < 0:
                raise FirmwareError(f"{self.name}: {context.name} charged {item} cycles")
            context.owed += item
        elif not isinstance(item, Flag):
            raise FirmwareError(f"{self.name}: {context.name} yielded {item!r}")
        elif not isinstance(context, Task):
            raise FirmwareError(f"{self.name}: handler {context.name} waited for {item.name}")
        elif not item._wait(context):
            self._context = None
        return False
