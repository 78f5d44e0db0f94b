"""What lies between two subdomains: numbering of traces, transfer between the sides, node pairs, search directions."""
