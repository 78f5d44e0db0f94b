"""From the last iteration to fields, forces and guards on them."""
