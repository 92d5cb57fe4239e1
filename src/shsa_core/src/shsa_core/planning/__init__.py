"""What would take a service over, and where: asked by healing, and by `shsa check`."""
