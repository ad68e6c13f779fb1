"""Work on many items by several processes: finished items stay finished, whatever happens to the processes."""
