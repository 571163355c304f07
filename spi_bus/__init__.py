"""The framed, acknowledged link between the two boards: codecs and state machine, no clock, no port."""
