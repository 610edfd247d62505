"""One participant at a time: the run of a design, and the page that it is run on."""
