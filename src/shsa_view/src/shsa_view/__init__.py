"""The live view: how a robot heals itself, as a page in the browser and as JSON."""
