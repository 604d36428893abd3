"""Tables, iteration lines and JSON documents: takes results, never computes them."""
