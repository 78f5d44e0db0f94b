"""Bytes to and from a code: pipes, files, messages, mesh formats."""
