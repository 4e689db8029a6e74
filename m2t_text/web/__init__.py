"""The page on which places are found, and the HTTP interface behind it."""
