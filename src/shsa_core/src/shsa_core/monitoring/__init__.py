"""How each publisher of each topic is doing."""
