"""The PaperReport goal: its plan and its tasks."""
