"""How the patient lies in the map (`views`), regions of the wall (`wall_regions`), and where to map next
(`advice`), in the words of the report.
"""
