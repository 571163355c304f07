"""An emulated XBee module (Series 1, 802.15.4 firmware): serial line on one side, air on the other.

API modes 1 and 2, the transparent mode, and command mode (+++) out of it; registers as in
`xbee_registers`. The serial line takes its time, ten bits an octet at the rate of BD, both ways:
at 9600 baud that is most of the way of a command. A chunk has come when its last octet has.

The MAC modes differ in two octets: with MM 0 and 3 a Digi header goes before the data, with 1 and 2
frames are plain IEEE 802.15.4, as other makers' radios read them. What the Digi header holds is not
published; here it is a zero and a counter (assumed), which other XBees of ours take off again.
Not modelled: association, sleep, encryption, I/O lines, node discovery, remote AT commands (they
are answered with "no response"), RR and repetitions of the Digi header's own. Source: the manual
that `xbee` names.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S
from radio_802154 import mac, xbee
from radio_802154.air import Air
from radio_802154.errors import LocalFrameError
from radio_802154.filtering import AddressFilter
from radio_802154.timing import channel_frequency_mhz
from radio_802154.xbee import (
    ApiFrame,
    AtCommand,
    AtCommandQueued,
    AtResponse,
    AtResult,
    ModemStatus,
    OtherFrame,
    RxPacket16,
    RxPacket64,
    TxOption,
    TxRequest16,
    TxRequest64,
    TxResult,
    TxStatus,
)
from radio_802154.xbee_radio import RadioSettings, XBeeRadio
from radio_802154.xbee_registers import (
    BAUD_RATES,
    BY_NAME,
    NO_SHORT_ADDRESS,
    NODE_IDENTIFIER,
    POWER_DBM,
    TRANSPARENT,
    Registers,
)

DIGI_HEADER_OCTETS: Final = 2
"""Before the data with MM 0 and 3: the manual gives the length only."""
PLAIN_MAC: Final = (1, 2)
"""Values of MM without a Digi header."""
ACK_MAC: Final = (0, 2)
"""Values of MM with acknowledgements."""
BOOT_FS: Final = 100 * FS_PER_MS
"""From power or FR until the module hears and answers (assumed)."""
BITS_PER_OCTET: Final = 10
"""Of the serial line: start, eight bits, stop."""
HARDWARE_RESET: Final = 0
WATCHDOG_RESET: Final = 1
"""`ModemStatus`; FR ends in the latter (assumed)."""
RX_ADDRESS_BROADCAST: Final = 0x02
RX_PAN_BROADCAST: Final = 0x04
"""Options of a received packet."""
REMOTE_COMMAND: Final = 0x17
REMOTE_RESPONSE: Final = 0x97
NO_RESPONSE: Final = 4
"""Status of the response to a remote AT command: those travel in frames with a Digi header only,
whose content is not published, so nobody ever answers one here."""
IDLE_FS: Final = FS_PER_S
"""A frame begun that goes on later than this is given up (assumed)."""


class XBeeModule:
    """One module.

    Args:
        scheduler, air: the run's; an antenna called `name` has been placed.
        written: registers that a WR has left, by name; defaults otherwise.
        on_serial: hears of octets that the module says, when the last of them is out.

    """

    def __init__(
        self,
        scheduler: Scheduler,
        air: Air,
        name: str,
        written: dict[str, int] | None = None,
        on_serial: Callable[[bytes], None] = lambda octets: None,
        seed: int = 0,
    ) -> None:
        self.registers = Registers(written)
        self.on_serial = on_serial
        self.packets_sent = 0
        """By radio, acknowledged or asking for no acknowledgement."""
        self.packets_failed = 0
        self.packets_received = 0
        self.restarts = 0
        self._scheduler = scheduler
        self._sequence = seed & 0xFF
        self._on = True
        self._in_free = self._out_free = 0
        self._life = 0  # what was under way in an earlier one does not happen
        self._last_octet_fs = 0
        self._decoder = xbee.Decoder(escaped=False)
        self._mode = TRANSPARENT
        self._text = bytearray()  # of transparent data, or of a command line
        self._commanding = False
        self._pluses = 0
        self._text_timer: Event | None = None
        self._radio = XBeeRadio(scheduler, air, name, self._settings(), self._received, seed)
        self._enter_mode()

    # --- supply --------------------------------------------------------------------------------

    def switch(self, on: bool) -> None:
        """Take the supply away or give it back; back, it says so when it has booted."""
        if on == self._on:
            return
        self._on = on
        self._life += 1
        self._scheduler.cancel(self._text_timer)
        self._in_free = self._out_free = self._scheduler.now
        self._radio.switch(False)
        if on:
            self.restarts += 1
            self._restart(HARDWARE_RESET)

    def _restart(self, status: int) -> None:
        self._on = False
        self._life += 1
        life = self._life
        self._radio.switch(False)
        self.registers.reset()

        def booted() -> None:
            if life != self._life:
                return
            self._on = True
            self._apply()
            self._radio.switch(True)
            self._enter_mode()
            if self._mode != TRANSPARENT:
                self._say(ModemStatus(status))

        self._scheduler.after(BOOT_FS, booted)

    # --- serial line ---------------------------------------------------------------------------

    @property
    def baud(self) -> int:
        """Rate of the serial line."""
        return self.registers.baud

    def _octets_fs(self, count: int) -> int:
        return count * BITS_PER_OCTET * FS_PER_S // self.baud

    def receive(self, octets: bytes) -> None:
        """Octets begin to arrive now; they are heard when the last of them has come."""
        if not self._on or not octets:
            return
        begin = max(self._in_free, self._scheduler.now)
        self._in_free = begin + self._octets_fs(len(octets))
        life = self._life

        def heard() -> None:
            if life == self._life:
                silent_fs = begin - self._last_octet_fs
                self._last_octet_fs = self._scheduler.now
                self._hear(octets, silent_fs)

        self._scheduler.at(self._in_free, heard)

    def _hear(self, octets: bytes, silent_fs: int) -> None:
        if self._mode == TRANSPARENT:
            self._hear_text(octets, silent_fs)
            return
        if silent_fs > IDLE_FS:
            for frame in self._decoder.idle():
                self._obey(frame)
        for frame in self._decoder.receive(octets):
            self._obey(frame)

    def _say(self, frame: ApiFrame) -> None:
        self._say_octets(xbee.encode(frame, escaped=self._mode == 2))

    def _say_octets(self, octets: bytes) -> None:
        begin = max(self._out_free, self._scheduler.now)
        self._out_free = begin + self._octets_fs(len(octets))
        life = self._life

        def said() -> None:
            if life == self._life:
                self.on_serial(octets)

        self._scheduler.at(self._out_free, said)

    # --- API -----------------------------------------------------------------------------------

    def _obey(self, frame: ApiFrame) -> None:
        match frame:
            case AtCommand(frame_id, command, parameter):
                self._answer(frame_id, command, parameter, queued=False)
            case AtCommandQueued(frame_id, command, parameter):
                self._answer(frame_id, command, parameter, queued=True)
            case TxRequest16(frame_id, destination, options, data):
                self._request(frame_id, destination, 2, options, data)
            case TxRequest64(frame_id, destination, options, data):
                short = destination == xbee.BROADCAST_64
                self._request(frame_id, destination, 2 if short else 8, options, data)
            case OtherFrame(kind, data) if kind == REMOTE_COMMAND and len(data) >= 14 and data[0]:
                answer = _remote_answer(data)
                self._say(OtherFrame(REMOTE_RESPONSE, answer))
            case _:
                pass  # what a host does not send is nothing to a module

    def _answer(self, frame_id: int, command: bytes, parameter: bytes, *, queued: bool) -> None:
        name = command.decode("ascii", "replace").upper()
        result, value = self._at(name, parameter, queued=queued)
        if frame_id:
            self._say(AtResponse(frame_id, command, result, value))
        self._after(name, result, bool(parameter) and not queued)

    def _at(self, name: str, parameter: bytes, *, queued: bool) -> tuple[AtResult, bytes]:
        """Carry out a command; return its outcome and the value that was asked for."""
        registers = self.registers
        if name in ("WR", "RE", "FR", "AC", "CN"):
            if name == "WR":
                registers.write()
            elif name == "RE":
                registers.restore()
            elif name == "AC":
                registers.apply()
            return AtResult.OK, b""
        if not parameter:
            value = registers.get(name)
            return (AtResult.INVALID_COMMAND, b"") if value is None else (AtResult.OK, value)
        if name == NODE_IDENTIFIER:
            return registers.rename(parameter), b""
        row = BY_NAME.get(name)
        if row is not None and len(parameter.lstrip(b"\0")) > row.octets:
            return AtResult.INVALID_PARAMETER, b""
        if not queued:
            registers.apply()
        return registers.set(name, int.from_bytes(parameter, "big"), queued=queued), b""

    def _after(self, name: str, result: AtResult, was_set: bool) -> None:
        """What follows from a command once it has been answered."""
        if result is not AtResult.OK:
            return
        if name == "FR":
            answered_fs = max(self._out_free, self._scheduler.now)
            self._scheduler.at(answered_fs + 1, lambda: self._restart(WATCHDOG_RESET))
        elif name in ("AC", "RE") or was_set:
            self._apply()
            if name in ("AC", "RE", "AP") and not self._commanding:
                self._enter_mode()

    def _enter_mode(self) -> None:
        mode = self.registers["AP"]
        if mode != self._mode or mode == TRANSPARENT:
            self._mode = mode
            self._text.clear()
            self._commanding, self._pluses = False, 0
        self._decoder = xbee.Decoder(escaped=mode == 2)

    def _apply(self) -> None:
        self._radio.settings = self._settings()

    def _settings(self) -> RadioSettings:
        registers = self.registers
        return RadioSettings(
            channel_frequency_mhz(registers["CH"]),
            POWER_DBM[registers["PL"]],
            AddressFilter(
                registers["ID"],
                min(registers["MY"], NO_SHORT_ADDRESS),
                registers.serial_number,
                pan_coordinator=bool(registers["CE"]),
            ),
            -float(registers["CA"]),
            registers["RN"],
        )

    # --- radio ---------------------------------------------------------------------------------

    def _request(
        self, frame_id: int, destination: int, octets: int, options: int, data: bytes
    ) -> None:
        """Send data to an address of so many octets, and say what became of it."""

        def done(result: TxResult) -> None:
            registers = self.registers
            if result is TxResult.SUCCESS:
                self.packets_sent += 1
            else:
                self.packets_failed += 1
                counter = "EA" if result is TxResult.NO_ACK else "EC"
                registers.note(counter, registers[counter] + 1)
            if frame_id and self._mode != TRANSPARENT:
                self._say(TxStatus(frame_id, result))

        registers = self.registers
        pan = registers["ID"]
        target_pan = mac.BROADCAST if options & TxOption.BROADCAST_PAN else pan
        mode = {2: mac.AddressingMode.SHORT, 8: mac.AddressingMode.EXTENDED}[octets]
        if registers["MY"] < NO_SHORT_ADDRESS:
            source = mac.Address(pan, registers["MY"])
        else:
            source = mac.Address(pan, registers.serial_number, mac.AddressingMode.EXTENDED)
        self._sequence = (self._sequence + 1) & 0xFF
        if registers["MM"] not in PLAIN_MAC:
            data = bytes((0, self._sequence)) + data
        wants_ack = registers["MM"] in ACK_MAC and not options & TxOption.DISABLE_ACK
        try:
            frame = mac.data_frame(
                self._sequence,
                mac.Address(target_pan, destination, mode),
                source,
                data,
                ack_request=wants_ack,
            )
        except LocalFrameError:
            return
        self._radio.send(frame, done)

    def _received(self, frame: mac.Frame, power_dbm: float) -> None:
        source, destination = frame.source, frame.destination
        if source is None:
            return
        data = frame.payload
        if self.registers["MM"] not in PLAIN_MAC:
            data = data[DIGI_HEADER_OCTETS:]
        self.packets_received += 1
        strength = min(255, max(0, round(-power_dbm)))
        self.registers.note("DB", strength)
        if self._mode == TRANSPARENT:
            if not self._commanding:
                self._say_octets(data)
            return
        options = 0
        if destination is not None:
            options |= RX_ADDRESS_BROADCAST if destination.is_broadcast else 0
            options |= RX_PAN_BROADCAST if destination.pan_id == mac.BROADCAST else 0
        data = data[: xbee.MAX_RF_DATA_OCTETS]
        short = source.mode is mac.AddressingMode.SHORT
        packet = RxPacket16 if short else RxPacket64
        self._say(packet(source.value, strength, options, data))

    # --- transparent mode and command mode ------------------------------------------------------

    def _hear_text(self, octets: bytes, silent_fs: int) -> None:
        self._scheduler.cancel(self._text_timer)
        if self._commanding:
            self._text += octets
            while b"\r" in self._text:
                line, _, rest = bytes(self._text).partition(b"\r")
                self._text[:] = rest
                self._command_line(line.decode("ascii", "replace").strip())
            self._text_timer = self._scheduler.after(
                self.registers["CT"] * 100 * FS_PER_MS, self._leave
            )
            return
        guard_fs = self.registers["GT"] * FS_PER_MS
        character = self.registers["CC"]
        if set(octets) == {character} and (silent_fs >= guard_fs or self._pluses):
            self._pluses += len(octets)
        else:
            self._pluses = 0
        self._text += octets
        if self._pluses == 3:
            self._text_timer = self._scheduler.after(guard_fs, self._begin_commands)
        elif len(self._text) >= xbee.MAX_RF_DATA_OCTETS:
            self._packetise()
        else:
            wait_fs = self._octets_fs(self.registers["RO"])
            self._text_timer = self._scheduler.after(wait_fs, self._packetise)

    def _packetise(self) -> None:
        """Send what has come by the serial line to DH and DL."""
        high, low = self.registers["DH"], self.registers["DL"]
        while self._text:
            data = bytes(self._text[: xbee.MAX_RF_DATA_OCTETS])
            del self._text[: len(data)]
            short = not high and low <= xbee.BROADCAST_16
            self._request(0, low if short else high << 32 | low, 2 if short else 8, 0, data)

    def _begin_commands(self) -> None:
        del self._text[-3:]
        self._packetise()
        self._pluses = 0
        self._commanding = True
        self._say_octets(b"OK\r")
        self._text_timer = self._scheduler.after(
            self.registers["CT"] * 100 * FS_PER_MS, self._leave
        )

    def _command_line(self, line: str) -> None:
        """`ATAP1`: answered OK, ERROR or with a value, ended by a carriage return."""
        name, argument = line[2:4].upper(), line[4:].strip()
        text = name == NODE_IDENTIFIER
        try:
            number = b"" if text or not argument else int(argument, 16).to_bytes(8, "big")
            parameter = argument.encode("ascii") if text else number
        except (ValueError, OverflowError):
            name = ""
        if line[:2].upper() != "AT" or len(name) != 2:
            self._say_octets(b"ERROR\r")
            return
        result, value = self._at(name, parameter, queued=False)
        if result is not AtResult.OK:
            self._say_octets(b"ERROR\r")
            return
        shown = f"{int.from_bytes(value, 'big'):X}".encode() if value else b"OK"
        self._say_octets((value if text and value else shown) + b"\r")
        self._after(name, result, bool(parameter))
        if name == "CN":
            self._leave()

    def _leave(self) -> None:
        self._commanding = False
        self._text.clear()
        self._enter_mode()


def _remote_answer(request: bytes) -> bytes:
    """Return the fields of the response: frame id, both addresses, command, status."""
    return request[:11] + request[12:14] + bytes((NO_RESPONSE,))


def resampled(octets: bytes, sent_baud: int, heard_baud: int) -> bytes:
    """Return what a receiver at another baud rate makes of octets on an idle line.

    The line's level bit by bit (start 0, eight bits, least significant first, stop 1), looked at in
    the middle of each of the receiver's bits; where the stop bit is not 1 the octet is still handed
    on, as UARTs do with a framing error, and the receiver waits for the line to be idle.
    """
    if sent_baud == heard_baud:
        return octets
    levels: list[int] = []
    for octet in octets:
        levels += [0, *(octet >> bit & 1 for bit in range(8)), 1]
    step = sent_baud / heard_baud
    heard = bytearray()
    at = 0.0  # in bits of the sender
    while at < len(levels):
        if levels[int(at)]:
            at = float(int(at) + 1)
            continue
        value = 0
        for bit in range(8):
            place = int(at + step * (1.5 + bit))
            value |= (levels[place] if place < len(levels) else 1) << bit
        heard.append(value)
        at += step * 9.5
        while at < len(levels) and not levels[int(at)]:
            at = float(int(at) + 1)
    return bytes(heard)


__all__ = ["BAUD_RATES", "XBeeModule", "resampled"]
