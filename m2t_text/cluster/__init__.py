"""Many indexes searched as one, on one machine or on many: shards, what lists them, and what serves them."""
