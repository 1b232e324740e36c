"""PaperReport: its plan, the task that a user starts, and the tasks of its stages."""
