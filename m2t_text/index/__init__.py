"""The Whoosh index of map documents: schema, column, queries, scores and store (paper, III-C, IV-D)."""
