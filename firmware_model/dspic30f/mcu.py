"""The dsPIC30F6014A assembled: clock, core, peripherals, pins, resets.

`firmware(mcu)` is called at every release from reset. It plays the part of crt0 and main: it makes
its RAM objects anew, installs handlers and spawns tasks, and whatever it made before is gone. What
survives is what survives on the chip: data EEPROM, and RCON unless the supply was lost.

A reset is always an event of its own. Firmware can only ask for one (`request_reset`, the RESET
instruction; or by not clearing the watchdog) and never runs beyond the instant in which it did.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_model.cpu import Cpu, CpuTiming
from firmware_model.dspic30f.adc import Adc
from firmware_model.dspic30f.eeprom import DataEeprom, blank_eeprom
from firmware_model.dspic30f.errors import LimitError
from firmware_model.dspic30f.i2c import I2cMaster
from firmware_model.dspic30f.output_compare import OutputCompare
from firmware_model.dspic30f.ports import ExternalInterrupts, Port
from firmware_model.dspic30f.spi import SpiSlave
from firmware_model.dspic30f.system import ResetCause, Watchdog, watchdog_period_fs
from firmware_model.dspic30f.timers import Timer
from firmware_model.dspic30f.uart import Uart
from firmware_model.interrupts import DspicInterrupts, DspicSource
from firmware_model.power import Rail
from firmware_model.registers import AddressSpace, RegisterBank
from firmware_model.scheduler import Event, Scheduler
from firmware_model.signals import Signal
from firmware_model.time import FS_PER_MS, FS_PER_US, Clock

# DS70143, table 5-1: interrupt sources in the order of their vector numbers from 0.
_VECTORS = """
    INT0 IC1 OC1 T1 IC2 OC2 T2 T3 SPI1 U1RX U1TX ADC NVM SI2C MI2C CN
    INT1 IC7 IC8 OC3 OC4 T4 T5 INT2 U2RX U2TX SPI2 C1 IC3 IC4 IC5 IC6
    OC5 OC6 OC7 OC8 INT3 INT4 C2
"""
INTERRUPT_SOURCES = (
    *(DspicSource(name, number) for number, name in enumerate(_VECTORS.split())),
    DspicSource("DCI", 41),
    DspicSource("LVD", 42),
)

# DS70046, section 6.3: four cycles of entry, the handler's first instruction executes in the fifth;
# RETFIE takes three (DS70157).
# A task switch is a call through a list of ready tasks, estimated: 20 instructions.
DSPIC_TIMING = CpuTiming(interrupt_entry_cycles=4, interrupt_exit_cycles=3, task_switch_cycles=20)

PLL_FACTORS = (1, 4, 8, 16)
MAX_FCY_3V3_HZ = 15_000_000  # DS70143, table 23-1: 15 MIPS at 3.0 to 3.6 V
POWER_UP_TIMER_FS = 64 * FS_PER_MS  # FPWRT = 64 ms (DS70143, parameter SY12)
OSCILLATOR_START_CYCLES = 1024  # of FOSC (parameter SY20)
PLL_LOCK_FS = 50 * FS_PER_US  # parameter OS52, maximum
RESET_DELAY_FS = 20 * FS_PER_US  # TRST (DS70046, table 8-2)
RAM_RETENTION_V = 1.5  # parameter DC12: below it a supply that comes back is a power-on


@dataclass(frozen=True, slots=True)
class DspicConfig:
    """Configuration fuses, crystal and currents.

    Currents are at 3.3 V, 25 °C and 15 MIPS: near the typical columns of DS70143, tables 23-5 and
    23-6, read by interpolation and so unconfirmed to better than 20 %.
    """

    crystal_hz: int = 7_372_800
    pll: int = 8
    drift_ppm: float = 0.0
    watchdog_prescaler_a: int = 64
    watchdog_prescaler_b: int = 4
    brown_out_v: float = 2.7  # BORV = 10
    run_a: float = 0.049
    idle_a: float = 0.028
    reset_a: float = 0.002


class DsPic30F6014A:
    """One dsPIC30F6014A on a supply rail.

    Args:
        name: of its power account and signals.
        scheduler: time.
        rail: AVDD and VDD; its voltage is also the ADC's reference.
        firmware: called at every release from reset.
        config: fuses and crystal.
        eeprom: cells of the data EEPROM; keep the bytearray to keep them over a power loss.

    """

    def __init__(
        self,
        name: str,
        scheduler: Scheduler,
        rail: Rail,
        firmware: Callable[[DsPic30F6014A], None],
        config: DspicConfig | None = None,
        eeprom: bytearray | None = None,
    ) -> None:
        self.config = config = config or DspicConfig()
        if config.pll not in PLL_FACTORS:
            raise LimitError(f"{name}: there is no PLL × {config.pll}")
        fcy_numerator = config.crystal_hz * config.pll
        if fcy_numerator > 4 * MAX_FCY_3V3_HZ:
            raise LimitError(f"{name}: {fcy_numerator / 4e6:.1f} MIPS is too fast for 3.3 V")
        self.name = name
        self.scheduler = scheduler
        self.rail = rail
        self.clock = clock = Clock(fcy_numerator // 4, config.drift_ppm, scheduler.now)
        self.interrupts = interrupts = DspicInterrupts(INTERRUPT_SOURCES)
        self.consumer = rail.consumer(
            "dsPIC30F6014A",
            {"active": config.run_a, "idle": config.idle_a, "reset": config.reset_a},
        )
        self.cpu = Cpu(name, scheduler, clock, interrupts, DSPIC_TIMING, self.consumer, "idle")
        line = interrupts.line
        timer5 = Timer(5, scheduler, clock, line("T5"))
        timer3 = Timer(3, scheduler, clock, line("T3"))
        timer2 = Timer(2, scheduler, clock, line("T2"), timer3)
        self.timers = {
            1: Timer(1, scheduler, clock, line("T1")),
            2: timer2,
            3: timer3,
            4: Timer(4, scheduler, clock, line("T4"), timer5),
            5: timer5,
        }
        self.oc1 = OutputCompare(1, scheduler, clock, timer2, timer3)
        self.adc = Adc(scheduler, clock, line("ADC"), rail.volts)
        timer3.on_match(self.adc.timer3_match)
        self.spi1 = SpiSlave(line("SPI1"))
        self.i2c = I2cMaster(scheduler, clock, line("MI2C"), interrupts.bank["IEC0"])
        # An operation of the I²C module completes when somebody looks: here, at its flag.
        self._ifs0 = interrupts.bank["IFS0"]
        self._ifs0.on_read = self._read_ifs0
        self.uart2 = Uart(2, scheduler, clock, line("U2RX"), line("U2TX"))
        self.ports = {letter: Port(letter) for letter in "ABCDFG"}
        self.external = ExternalInterrupts(line("INT1"))
        self.ports["A"].pin(12).watch(self.external.int1)  # INT1/RA12 on the 80-pin part
        self.eeprom = DataEeprom(scheduler, line("NVM"), eeprom or blank_eeprom())
        period_fs = watchdog_period_fs(config.watchdog_prescaler_a, config.watchdog_prescaler_b)
        self.watchdog = Watchdog(scheduler, self.cpu, period_fs, self.request_reset)
        self.reg = AddressSpace(self._banks())
        self.resets = 0
        """Releases from reset so far."""
        self.reset_listener: Callable[[ResetCause], None] | None = None
        """Told of every reset at its instant."""
        self._firmware = firmware
        self._lowest_v = 0.0
        self._event: Event | None = None
        self._reset_asked = False
        self._powered = False
        rail.volts.watch(self._supply_changed)
        self._supply_changed(rail.volts.value)

    def _banks(self) -> list[RegisterBank]:
        return [
            self.interrupts.bank,
            self.external.bank,
            *(timer.bank for timer in self.timers.values()),
            self.oc1.bank,
            self.i2c.bank,
            self.uart2.bank,
            self.spi1.bank,
            self.adc.bank,
            *(port.bank for port in self.ports.values()),
            self.watchdog.bank,
            self.eeprom.bank,
        ]

    def pin(self, name: str) -> Signal[bool]:
        """Return the wire at a pin, such as RD8."""
        return self.ports[name[1]].pin(int(name[2:]))

    def _read_ifs0(self) -> int:
        self.i2c.settle()
        return self._ifs0.value

    def request_reset(self, cause: ResetCause = ResetCause.SOFTWARE) -> None:
        """Reset at this instant, as an event: the RESET instruction by default."""
        if not self._reset_asked:
            self._reset_asked = True
            self.scheduler.at(self.scheduler.now, lambda: self._asked(cause))

    def _asked(self, cause: ResetCause) -> None:
        self._reset_asked = False
        if self._powered:
            self._enter_reset(cause)
            self._release_after(RESET_DELAY_FS)

    def _supply_changed(self, volts: float) -> None:
        """Hold the chip in reset below the brown-out voltage, and start it above."""
        self._lowest_v = min(self._lowest_v, volts)
        if volts < self.config.brown_out_v:
            if self._powered:
                self._powered = False
                if self.cpu.running:
                    # The supply may fall at an instant at which the CPU executes.
                    self.scheduler.at(self.scheduler.now, self._brown_out)
                else:
                    self._brown_out()
            elif volts < RAM_RETENTION_V:
                self.consumer.enter("off")
        elif not self._powered:
            self._powered = True
            cause = ResetCause.BROWN_OUT
            if self._lowest_v < RAM_RETENTION_V:
                cause |= ResetCause.POWER_ON
            self._lowest_v = volts
            self._enter_reset(cause)
            oscillator_fs = OSCILLATOR_START_CYCLES * 10**15 // self.config.crystal_hz
            self._release_after(POWER_UP_TIMER_FS + oscillator_fs + PLL_LOCK_FS)

    def _brown_out(self) -> None:
        if not self._powered:
            self._stop("off" if self.rail.volts.value < RAM_RETENTION_V else "reset")

    def _enter_reset(self, cause: ResetCause) -> None:
        self._stop("reset")
        self.watchdog.reset(cause)
        if self.reset_listener is not None:
            self.reset_listener(cause)

    def _stop(self, state: str) -> None:
        self.scheduler.cancel(self._event)
        self._event = None
        self.cpu.halt(state)
        for timer in self.timers.values():
            timer.reset()
        self.oc1.reset()
        self.adc.reset()
        self.spi1.reset()
        self.i2c.reset()
        self.uart2.reset()
        for port in self.ports.values():
            port.reset()
        self.external.reset()
        self.eeprom.reset()
        self.watchdog.stop()

    def _release_after(self, delay_fs: int) -> None:
        self._event = self.scheduler.after(delay_fs, self._boot)

    def _boot(self) -> None:
        self._event = None
        self.resets += 1
        self._firmware(self)
        self.cpu.start()
