"""The running process: signals, exit status, progress, and each task's log."""
