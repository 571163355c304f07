"""The MAC codec against captured frames, the standard's tables, and itself on random frames."""

import shutil
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radio_802154.errors import (
    LocalFrameError,
    RadioError,
    RemoteFrameError,
    UnsupportedFrameError,
)
from radio_802154.fcs import append_fcs, strip_fcs
from radio_802154.mac import (
    BROADCAST,
    MAX_CONTENT_OCTETS,
    Address,
    AddressingMode,
    CommandId,
    Frame,
    FrameType,
    ack_frame,
    acknowledges,
    data_frame,
    decode,
    encode,
)

# Frames with FCS as they stand in the regression tests of scapy (test/scapy/layers/dot15d4.uts),
# and what their dissection is there.
BEACON = bytes.fromhex("008089aa990000ffcf0000002284fecaefbeedfecefaffffff0058a4")
REALIGNMENT = bytes.fromhex("23cc89ffff8877665544332211aa99ffeeddccbbaa998808aa99dec014adde5c21")
LOWPAN = bytes.fromhex(
    "41ccb5cdab161514feff131202554433feff22110278f600068000010050c4fa000001f789f3025f501804c44828"
    "0000436f6e74656e742d747970653a20746578742f6373730d0a0d0ac116"
)
STANDARD_ACK = bytes.fromhex("02006ae479")  # example of clause 7.2.1.9


def extended(pan_id: int, value: int) -> Address:
    return Address(pan_id, value, AddressingMode.EXTENDED)


def test_captured_beacon() -> None:
    frame = decode(strip_fcs(BEACON))
    assert frame == Frame(
        FrameType.BEACON,
        sequence=137,
        source=Address(0x99AA, 0x0000),
        payload=BEACON[7:-2],
    )
    assert append_fcs(encode(frame)) == BEACON


def test_captured_coordinator_realignment_between_two_pans() -> None:
    frame = decode(strip_fcs(REALIGNMENT))
    assert frame.frame_type is FrameType.COMMAND
    assert frame.command is CommandId.COORDINATOR_REALIGNMENT
    assert frame.ack_request
    assert frame.destination == extended(0xFFFF, 0x1122334455667788)
    assert frame.source == extended(0x99AA, 0x8899AABBCCDDEEFF)
    assert not frame.pan_id_compression
    assert append_fcs(encode(frame)) == REALIGNMENT


def test_captured_data_frame_with_extended_addresses_in_one_pan() -> None:
    frame = decode(strip_fcs(LOWPAN))
    assert frame.frame_type is FrameType.DATA
    assert frame.sequence == 0xB5
    assert frame.pan_id_compression
    assert frame.destination == extended(0xABCD, 0x02_12_13_FF_FE_14_15_16)
    assert frame.source == extended(0xABCD, 0x02_11_22_FF_FE_33_44_55)
    assert frame.payload.startswith(b"\x78\xf6")
    assert append_fcs(encode(frame)) == LOWPAN


def test_acknowledgement_of_the_standard() -> None:
    ack = decode(strip_fcs(STANDARD_ACK))
    assert ack == ack_frame(0x6A)
    assert append_fcs(encode(ack)) == STANDARD_ACK
    wanted = data_frame(0x6A, Address(1, 2), Address(1, 3), b"", ack_request=True)
    assert acknowledges(ack, wanted)
    assert not acknowledges(ack_frame(0x6B), wanted)
    unwanted = data_frame(0x6A, Address(1, 2), Address(1, 3), b"")
    assert not acknowledges(ack, unwanted)


@pytest.mark.parametrize("end", range(len(REALIGNMENT) - 12))
def test_a_truncated_frame_is_the_senders_fault(end: int) -> None:
    with pytest.raises(RemoteFrameError):
        decode(REALIGNMENT[:end])


@pytest.mark.parametrize(
    ("octets", "error", "words"),
    [
        ("04 00 00", UnsupportedFrameError, "frame type 4"),
        ("09 88 00 22 00 01 00 02 00", UnsupportedFrameError, "secured"),
        ("41 a8 00 22 00 01 00 02 00", UnsupportedFrameError, "version 2"),
        ("41 84 00 22 00 01 00 02 00", RemoteFrameError, "destination addressing mode 1"),
        ("41 48 00 22 00 01 00 02 00", RemoteFrameError, "source addressing mode 1"),
        ("41 08 00 22 00 01 00", RemoteFrameError, "without a source"),
        ("41 80 00 22 00 01 00", RemoteFrameError, "without a destination"),
        ("01 00 00", RemoteFrameError, "at least one address"),
        ("02 00 00 01", RemoteFrameError, "three octets"),
        ("03 08 00 22 00 01 00", RemoteFrameError, "command id"),
        ("00 08 00 22 00 01 00", RemoteFrameError, "beacon has a source"),
    ],
)
def test_octets_that_are_no_frame(octets: str, error: type[RadioError], words: str) -> None:
    with pytest.raises(error, match=words):
        decode(bytes.fromhex(octets))


def test_frames_that_cannot_be_built() -> None:
    here, there = Address(1, 2), Address(2, 3)
    with pytest.raises(LocalFrameError, match="8 bits"):
        Frame(FrameType.DATA, 256, here, there)
    with pytest.raises(LocalFrameError, match="two PANs"):
        Frame(FrameType.DATA, 0, here, there, pan_id_compression=True)
    with pytest.raises(LocalFrameError, match="both addresses"):
        Frame(FrameType.DATA, 0, here, pan_id_compression=True)
    with pytest.raises(LocalFrameError, match="16 bits"):
        Address(1, 0x10000)
    with pytest.raises(LocalFrameError, match="at least one address"):
        data_frame(0, None, None, b"")
    with pytest.raises(LocalFrameError, match="127"):
        encode(data_frame(0, here, Address(1, 3), bytes(MAX_CONTENT_OCTETS - 8)))
    assert len(encode(data_frame(0, here, Address(1, 3), bytes(MAX_CONTENT_OCTETS - 9)))) == 125


def test_a_broadcast_asks_for_no_acknowledgement() -> None:
    frame = data_frame(0, Address(1, BROADCAST), Address(1, 3), b"", ack_request=True)
    assert not frame.ack_request


addresses = st.one_of(
    st.builds(Address, st.integers(0, 0xFFFF), st.integers(0, 0xFFFF)),
    st.builds(extended, st.integers(0, 0xFFFF), st.integers(0, 2**64 - 1)),
)


@given(
    sequence=st.integers(0, 255),
    destination=st.none() | addresses,
    source=addresses,
    payload=st.binary(max_size=102),
    ack_request=st.booleans(),
    pending=st.booleans(),
    version=st.integers(0, 1),
)
def test_what_is_encoded_is_decoded(
    sequence: int,
    destination: Address | None,
    source: Address,
    payload: bytes,
    ack_request: bool,
    pending: bool,
    version: int,
) -> None:
    frame = Frame(
        FrameType.DATA,
        sequence,
        destination,
        source,
        payload,
        ack_request=ack_request,
        frame_pending=pending,
        version=version,
        pan_id_compression=destination is not None and destination.pan_id == source.pan_id,
    )
    assert decode(encode(frame)) == frame


@given(st.binary(max_size=125))
def test_any_octets_are_read_or_refused(octets: bytes) -> None:
    try:
        frame = decode(octets)
    except RemoteFrameError:
        return
    again = encode(frame)
    assert again[2:] == octets[2:]
    reserved = 0b111 << 7  # reserved bits are ignored on reception (clause 7.2.1.1.7)
    assert int.from_bytes(again[:2], "little") == int.from_bytes(octets[:2], "little") & ~reserved


@pytest.mark.oracle
def test_wireshark_reads_what_is_encoded(tmp_path) -> None:  # type: ignore[no-untyped-def]
    if shutil.which("tshark") is None or shutil.which("text2pcap") is None:
        pytest.skip("tshark and text2pcap (Debian packages tshark, wireshark-common) not installed")
    frames = [
        data_frame(7, Address(0x22, 0x1234), Address(0x22, 5), b"\x3f\x06", ack_request=True),
        data_frame(8, extended(0x22, 0x1122334455667788), Address(0x99, 5), b"x"),
        Frame(FrameType.COMMAND, 9, Address(0xFFFF, 0xFFFF), None, b"\x07"),
        ack_frame(7, frame_pending=True),
    ]
    dump = tmp_path / "frames.txt"
    dump.write_text("".join("0000 " + append_fcs(encode(f)).hex(" ") + "\n\n" for f in frames))
    pcap = tmp_path / "frames.pcap"
    subprocess.run(["text2pcap", "-q", "-l", "195", dump, pcap], check=True, capture_output=True)
    fields = "frame_type seq_no fcs_ok pending ack_request dst_pan dst16 dst64 src16 src_pan cmd"
    options = [part for name in fields.split() for part in ("-e", f"wpan.{name}")]
    # one TinyOS frame is no 6LoWPAN: keep the upper dissectors out of it
    result = subprocess.run(
        ["tshark", "-r", pcap, "-T", "fields", "-E", "separator=;", *options],
        check=True,
        capture_output=True,
        text=True,
    )
    assert [line.split(";") for line in result.stdout.splitlines()] == [
        ["0x0001", "7", "1", "0", "1", "0x0022", "0x1234", "", "0x0005", "", ""],
        [
            "0x0001",
            "8",
            "1",
            "0",
            "0",
            "0x0022",
            "",
            "11:22:33:44:55:66:77:88",
            "0x0005",
            "0x0099",
            "",
        ],
        ["0x0003", "9", "1", "0", "0", "0xffff", "0xffff", "", "", "", "0x07"],
        ["0x0002", "7", "1", "1", "0", "", "", "", "", "", ""],
    ]
