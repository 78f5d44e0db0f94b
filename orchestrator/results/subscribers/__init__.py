"""What listens to the loop: history, progress, checkpoint."""
