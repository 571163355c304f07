"""MSP430F1611: the peripherals wired together, resets and supply.

`Msp430F1611` owns the clocks, the interrupt controller, the CPU and the peripherals, and knows what
a power-up clear (PUC) and a power-on reset (POR) reach. Firmware is a function that gets the MCU at
every release from reset; it installs handlers and spawns tasks, as `main` of a C program does.

A reset that firmware causes (watchdog, a wrong key) takes place as an event of its own in the same
instant, never inside the firmware that caused it. The supply is a signal: below the brown-out
threshold everything but the flash is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

from firmware_model.cpu import Cpu, CpuTiming
from firmware_model.interrupts import Msp430Interrupts
from firmware_model.msp430 import dma as _dma
from firmware_model.msp430 import sfr as _sfr
from firmware_model.msp430.adc12 import Adc12
from firmware_model.msp430.clocks import BasicClock
from firmware_model.msp430.dma import DmaController
from firmware_model.msp430.flash import FlashController
from firmware_model.msp430.memory import Msp430AddressSpace, Ram
from firmware_model.msp430.multiplier import Multiplier
from firmware_model.msp430.ports import Port
from firmware_model.msp430.sfr import SpecialFunctions
from firmware_model.msp430.timer import Timer
from firmware_model.msp430.usart import Usart
from firmware_model.msp430.watchdog import Watchdog
from firmware_model.power import OFF
from firmware_model.registers import RegisterBank
from firmware_model.scheduler import Event, Priority, Scheduler
from firmware_model.signals import Signal
from firmware_model.time import FS_PER_NS, FS_PER_US

if TYPE_CHECKING:
    from firmware_model.power import Rail

Firmware = Callable[["Msp430F1611"], None]

# SLAS368, "interrupt vector addresses": place in the table, 0xFFE0 + 2 × place.
VECTORS = MappingProxyType(
    {
        "NMI": 14,
        "TIMERB0": 13,
        "TIMERB1": 12,
        "COMPARATORA": 11,
        "WDT": 10,
        "USART0RX": 9,
        "USART0TX": 8,
        "ADC12": 7,
        "TIMERA0": 6,
        "TIMERA1": 5,
        "PORT1": 4,
        "USART1RX": 3,
        "USART1TX": 2,
        "PORT2": 1,
        "DACDMA": 0,
    }
)

# SLAS368, "supply current": at 3 V, amperes; active is per megahertz of MCLK, and changes with the
# supply (330 µA at 2.2 V to 500 µA at 3 V). LPM1 differs from LPM0 only while nothing uses the DCO.
ACTIVE_A_PER_MHZ = 500e-6
ACTIVE_A_PER_MHZ_PER_V = (500e-6 - 330e-6) / (3.0 - 2.2)
SLEEP_A = MappingProxyType(
    {"lpm0": 75e-6, "lpm1": 75e-6, "lpm2": 17e-6, "lpm3": 2.6e-6, "lpm4": 0.2e-6}
)

TIMING = CpuTiming(
    # SLAU049, section 3.4.1: interrupt acceptance takes 6 cycles, RETI 5.
    interrupt_entry_cycles=6,
    interrupt_exit_cycles=5,
    # TinyOS 2 SchedulerBasicP compiled for MSP430: popTask and the call of runTask. Estimated from
    # its instructions; no published measurement.
    task_switch_cycles=40,
    # SLAS368, "wake-up from lower-power modes": t(LPM2) = 100 ns, t(LPM3) and t(LPM4) ≤ 6 µs.
    wake_fs=MappingProxyType(
        {"lpm2": 100 * FS_PER_NS, "lpm3": 6 * FS_PER_US, "lpm4": 6 * FS_PER_US}
    ),
)

# SLAS368, "brownout/reset (BOR)": V(B_IT−) at most 1.71 V, hysteresis typically 130 mV, and 2 ms at
# most until the device is released.
BROWNOUT_FALLING_V = 1.71
BROWNOUT_RISING_V = BROWNOUT_FALLING_V + 0.13
BROWNOUT_DELAY_FS = 2_000 * FS_PER_US


class Peripheral(Protocol):
    """What every peripheral offers to its MCU."""

    bank: RegisterBank

    def reset(self, por: bool) -> None:
        """Take a PUC, or with `por` a POR."""


class Msp430F1611:
    """The microcontroller of TelosB.

    `firmware` is called with the MCU at every release from reset. `lfxt1_drift_ppm` is the error of
    the watch crystal, `dco_factor` this device's DCO against the typical one.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        rail: Rail,
        firmware: Firmware,
        name: str = "msp430",
        lfxt1_drift_ppm: float = 0.0,
        dco_factor: float = 1.0,
    ) -> None:
        self.name = name
        self.scheduler = scheduler
        self.rail = rail
        self.firmware = firmware
        self.last_reset = ""
        """Cause of the last reset, for people; firmware reads WDTIFG, KEYV and so on."""
        self.resets = 0
        self.powered = False
        self._release: Event | None = None
        self._pending_puc: Event | None = None

        self.interrupts = interrupts = Msp430Interrupts()
        lines = {line: interrupts.line(line, place) for line, place in VECTORS.items()}
        lines["NMI"].on_accept = self._accept_nmi
        self._nmi = lines["NMI"]

        self.clocks = BasicClock(scheduler, lfxt1_drift_ppm, dco_factor)
        aclk, smclk = self.clocks.aclk, self.clocks.smclk
        self.consumer = rail.consumer("MSP430F1611", {Cpu.ACTIVE: 0.0, "reset": 0.0, **SLEEP_A})
        self.cpu = Cpu(name, scheduler, self.clocks.mclk, interrupts, TIMING, self.consumer, "lpm3")
        self.cpu.on_sleep = self.clocks.sleep
        self.cpu.on_wake = self.clocks.wake

        self.memory = bytearray(b"\xff" * 0x10000)
        self.ram = Ram(self.memory)
        self.sfr = SpecialFunctions()
        self.clocks.on_fault = self.sfr.raise_oscillator_fault
        self.dma = DmaController(scheduler, lines["DACDMA"])
        triggers = self.dma.triggers
        me1, me2 = self.sfr.bank["ME1"], self.sfr.bank["ME2"]
        self.usart0 = Usart(
            0, scheduler, aclk, smclk, me1,
            self.sfr.flag(1, _sfr.URXIFG0, lines["USART0RX"]),
            self.sfr.flag(1, _sfr.UTXIFG0, lines["USART0TX"]),
            triggers, _dma.URXIFG0_TRIGGER, _dma.UTXIFG0_TRIGGER,
        )  # fmt: skip
        self.usart1 = Usart(
            1, scheduler, aclk, smclk, me2,
            self.sfr.flag(2, _sfr.URXIFG1, lines["USART1RX"]),
            self.sfr.flag(2, _sfr.UTXIFG1, lines["USART1TX"]),
            triggers, _dma.URXIFG1_TRIGGER, _dma.UTXIFG1_TRIGGER,
        )  # fmt: skip
        self.usart0.memory = self.usart1.memory = self.memory
        self.timer_a = Timer(
            "A", 3, scheduler, aclk, smclk, lines["TIMERA0"], lines["TIMERA1"],
            triggers, {0: _dma.TACCR0_TRIGGER, 2: _dma.TACCR2_TRIGGER},
        )  # fmt: skip
        self.timer_b = Timer(
            "B", 7, scheduler, aclk, smclk, lines["TIMERB0"], lines["TIMERB1"],
            triggers, {0: _dma.TBCCR0_TRIGGER, 2: _dma.TBCCR2_TRIGGER},
        )  # fmt: skip
        self.dma.watch_timers(self.timer_a.triggers_changed)
        self.dma.watch_timers(self.timer_b.triggers_changed)
        self.watchdog = Watchdog(
            scheduler, aclk, smclk,
            self.sfr.flag(1, _sfr.WDTIFG, lines["WDT"]), self.request_reset,
        )  # fmt: skip
        self.flash = FlashController(
            scheduler, self.clocks, self.memory, self.request_reset, self._update_nmi
        )
        self.multiplier = Multiplier(triggers, _dma.MULTIPLIER_TRIGGER)
        self.adc12 = Adc12(
            scheduler, self.clocks, rail, lines["ADC12"], triggers, _dma.ADC12_TRIGGER
        )
        self.adc12.connect_timers(
            self.timer_a.outputs[1], self.timer_b.outputs[0], self.timer_b.outputs[1]
        )
        self.ports = {n: Port(n, lines.get(f"PORT{n}")) for n in range(1, 7)}
        self._wire_pins()

        self._peripherals: tuple[Peripheral, ...] = (
            self.clocks, self.sfr, self.dma, self.usart0, self.usart1, self.timer_a, self.timer_b,
            self.watchdog, self.flash, self.multiplier, self.adc12, *self.ports.values(),
        )  # fmt: skip
        self.reg = Msp430AddressSpace(
            (peripheral.bank for peripheral in self._peripherals), self.memory, self.flash
        )
        self.dma.space, self.dma.cpu, self.dma.clock = self.reg, self.cpu, self.clocks.mclk
        self.flash.cpu = self.cpu
        self.sfr.watch(self._update_nmi)
        self.watchdog.power_off()
        self.clocks.mclk.watch(self._set_active_current)
        rail.volts.watch(self._supply_changed)
        self._supply_changed(rail.volts.value)

    # --- wiring -----------------------------------------------------------------------

    def pin_signal(self, port: int, bit: int) -> Signal[bool]:
        """Return what the MCU drives on a pin."""
        return self.ports[port].pins[bit].output

    def _wire_pins(self) -> None:
        """Connect timers to their pins (SLAS368, "terminal functions" and timer signal tables)."""
        ports, timer_a, timer_b = self.ports, self.timer_a, self.timer_b
        for n, block in ((1, 0), (2, 1), (3, 2), (5, 0), (6, 1), (7, 2)):
            ports[1].module(n, timer_a.outputs[block])
        for n, block in ((2, 0), (3, 1), (4, 2)):
            ports[2].module(n, timer_a.outputs[block])
        for n in range(7):
            ports[4].module(n, timer_b.outputs[n])
            pin = ports[4].pins[n].input
            timer_b.capture_input(n, "A", pin)
            timer_b.capture_input(n, "B", self.clocks.aclk if n == 6 else pin)
        for n in range(3):
            timer_a.capture_input(n, "A", ports[1].pins[n + 1].input)
        timer_a.capture_input(0, "B", ports[2].pins[2].input)
        timer_a.capture_input(2, "B", self.clocks.aclk)  # CCI1B is the comparator's output
        ports[2].pins[6].input.watch(self.dma.external_trigger)  # DMAE0

    # --- resets -----------------------------------------------------------------------

    def request_reset(self, cause: str) -> None:
        """Ask for a PUC: it takes place in this instant, after the code that asked."""
        if self._pending_puc is None:
            self._pending_puc = self.scheduler.at(
                self.scheduler.now, lambda: self._power_up_clear(cause)
            )

    def press_reset(self) -> None:
        """Pull RST/NMI low and let it go: a POR."""
        self._reset("RST/NMI", por=True)

    def _power_up_clear(self, cause: str) -> None:
        self._reset(cause, por=False)

    def _reset(self, cause: str, por: bool) -> None:
        if not self.powered:
            return
        self._halt("reset")
        self._clear(por)
        self._schedule_release(cause, 0)

    def _clear(self, por: bool) -> None:
        self.cpu.sleep_state = "lpm3"
        for peripheral in self._peripherals:
            peripheral.reset(por)
        self._update_nmi()

    def _halt(self, state: str) -> None:
        self.scheduler.cancel(self._pending_puc)
        self._pending_puc = None
        self.scheduler.cancel(self._release)
        self._release = None
        self.cpu.halt(state)

    def _schedule_release(self, cause: str, delay_fs: int) -> None:
        self.last_reset = cause
        self._release = self.scheduler.after(delay_fs, self._boot)

    def _boot(self) -> None:
        self._release = None
        self.resets += 1
        self.ram.release()
        self.firmware(self)
        self.cpu.start()

    # --- supply -----------------------------------------------------------------------

    def _supply_changed(self, volts: float) -> None:
        if self.cpu.executing:  # firmware did something that made the rail move
            self.scheduler.at(
                self.scheduler.now,
                lambda: self._supply_changed(self.rail.volts.value),
                Priority.WIRE,
            )
        elif self.powered and volts < BROWNOUT_FALLING_V:
            self.powered = False
            self.flash.power_off()
            self._halt(OFF)
            self._clear(por=True)
            self.watchdog.power_off()
            self.ram.lose_power()
        elif not self.powered and volts >= BROWNOUT_RISING_V:
            self.powered = True
            self._clear(por=True)
            self._set_active_current()
            self.consumer.enter("reset")
            self._schedule_release("power-up", BROWNOUT_DELAY_FS)
        elif self.powered:
            self._set_active_current()

    def _set_active_current(self) -> None:
        """Follow MCLK and the supply with the current of the active mode."""
        megahertz = float(self.clocks.mclk.frequency_hz) / 1e6
        volts = self.rail.volts.value
        amps = megahertz * (ACTIVE_A_PER_MHZ + ACTIVE_A_PER_MHZ_PER_V * (volts - 3.0))
        self.consumer.set_current(Cpu.ACTIVE, max(0.0, amps))

    # --- NMI --------------------------------------------------------------------------

    def _update_nmi(self) -> None:
        """Drive NMI: NMIIFG, OFIFG or ACCVIFG with its enable (SLAU049, section 2.2.2)."""
        enables, flags = self.sfr.bank["IE1"].value, self.sfr.bank["IFG1"].value
        pending = enables & flags & (_sfr.NMIIE | _sfr.OFIE)
        self._nmi.drive(bool(pending or (enables & _sfr.ACCVIE and self.flash.violated)))

    def _accept_nmi(self) -> None:
        """Clear the three enables, as taking the NMI does; its handler sets them again."""
        self.sfr.bank["IE1"].value &= ~(_sfr.NMIIE | _sfr.OFIE | _sfr.ACCVIE)
        self._update_nmi()
