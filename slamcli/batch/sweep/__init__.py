"""Monte-Carlo and parameter studies: a case, axes of values, seeds; one table and its means."""
