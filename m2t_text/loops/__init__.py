"""Loop closures: places that a drive comes back to, as constraints between its poses."""
