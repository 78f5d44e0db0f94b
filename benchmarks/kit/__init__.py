"""What studies are made of: matrices of configurations, tables, figures, commands, true errors."""
