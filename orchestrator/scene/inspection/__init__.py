"""What a mesh or a scene is made of, as lists: volumes, surfaces, and the pairs of faces that lie on each other."""
