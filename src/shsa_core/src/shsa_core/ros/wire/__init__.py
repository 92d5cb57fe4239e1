"""How the nodes talk: names of topics, services and parameters, and what messages say."""
