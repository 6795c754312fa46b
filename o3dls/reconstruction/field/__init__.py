"""The field that is added to the moved prior's signed distance: splines, their equations, their deviation."""
