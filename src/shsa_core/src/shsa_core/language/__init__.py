"""The language of relations: what a function may say, its unit and its range."""
