"""Where link bytes leave the protocol: emulated wires, ptys, serial ports, CAN."""
