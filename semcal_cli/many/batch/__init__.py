"""Batches of drives, which run in processes that may crash or hang and leave a record of each outcome."""
