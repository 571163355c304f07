"""The network layer of a shoal, as state machines that know no clock and no radio.

Each takes what was received and the time, and gives messages to send and events. `docs/network.md`
has the protocols in words, their bounds and what was measured.
"""
