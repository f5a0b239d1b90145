"""Local methods: matrix inequalities that hold for the points of an ellipsoid around the equilibrium, and no further."""
