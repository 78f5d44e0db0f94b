"""Interfaces whose sides are meshed each on its own: from two surface meshes to transfer operators (dual mortar).

``operators`` says what such an interface carries.
"""
