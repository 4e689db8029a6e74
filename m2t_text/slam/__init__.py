"""From a drive with loops to a corrected trajectory and a map."""
