"""The linear stage: loads, back-substitutions, macro problem."""
