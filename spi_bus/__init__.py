"""The framed, acknowledged link between the two boards: codecs, state machine, transports."""
