"""Where subdomains meet, and which law holds there."""
