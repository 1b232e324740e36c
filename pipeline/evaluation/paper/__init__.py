"""The paper's evaluation in numbers and pictures: its sweeps, tables and limits, and the report made of them."""
