"""How the nodes talk: names of topics, services and parameters, and what their messages say to
the cores.
"""
