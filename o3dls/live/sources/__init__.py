"""Where the points of a live session come from: a file that grows, a navigation system, an earlier map."""
