"""What is measured while iterating, and when that is enough."""
