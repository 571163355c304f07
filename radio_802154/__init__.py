"""IEEE 802.15.4 frames, the CC2420 radio chip, and the medium between robots."""
