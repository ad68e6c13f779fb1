"""Many drives, and rigs of several cameras."""
