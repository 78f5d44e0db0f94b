"""The paper's figures and tables, with its own settings and with the defaults."""
