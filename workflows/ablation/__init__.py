"""The Ablations goal: its plan, its task, and the comparison at the end."""
