"""The commands, a file each; `tools.commands.table` lists them."""
