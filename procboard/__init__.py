"""The TelosB processing board: flash, radio, storage, network, applications."""
