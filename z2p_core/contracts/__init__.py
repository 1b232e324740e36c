"""What plugins are checked for, one module for each kind; `z2p_core.testing` offers the checks to plugin authors."""
