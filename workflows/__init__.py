"""luigi tasks, one a stage; each run() calls one function of `pipeline`."""
