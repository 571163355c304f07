"""dsPIC30F6014A peripherals at register level, as far as the navigation board uses them.

Addresses, names and bit positions are those of DS70143 (dsPIC30F6011A/6012A/6013A/6014A data sheet)
and DS70046 (dsPIC30F family reference manual). The timer map was held against a public compiler
header; the rest is stated from the data sheet's register summaries.
"""
