"""Built-in plugins. Nobody imports this package: the registry reaches it through entry points, as any stranger's."""
