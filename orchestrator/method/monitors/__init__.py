"""What watches the iterations, one file each; ``registry.MONITORS`` has them in the order in which they are asked."""
