"""Many items of work, done by several processes: what is done stays done, whatever happens to a process or to all."""
