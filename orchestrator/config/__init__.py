"""The YAML's model, its defaults with their reasons, and errors with line numbers.

Nothing is imported here. ``model`` has the whole, ``load`` goes from file to configuration; laws, loads and codes bring models of
their own, which are imported when a configuration names them: to know the model takes neither numpy nor any of their rooms.
"""
