"""Numbers that are measured on a surface, such as areas and volumes, with the interval of its samples."""
