"""Many drives: each by a process that may crash or hang, with a record that says what came of what."""
