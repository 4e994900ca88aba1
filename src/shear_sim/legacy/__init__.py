"""Output files of the historical program particleShear, and studies made of them.

A run is one text file: a header, the line ``Detailed stress tensor data`` and a table. The analysis
in R split it into ``header_<name>.txt``, which ends with that line, and ``stress_<name>.rda`` with
the table. Reading order: `headers` and `series` (what is in the files), `study_file` (what that is
in our words), `importing` (the results folder that is made of it).
"""
