class XBeePort: pass
