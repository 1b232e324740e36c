"""The report's page: tables, plots, captions, and the numbers they are made of."""
