"""The commands of `shsa` that show a running robot; each module is one."""
