"""Exports of mapping systems (CARTO 3, EnSite, OpenEP) and the live link to navigation research systems;
`study_import` makes a case folder of them.
"""
