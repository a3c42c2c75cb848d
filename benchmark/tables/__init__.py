"""The tables: which runs each compares, the page and the plots that come of them."""
