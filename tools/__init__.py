"""The command line, scenarios, the bench, records and reports."""
