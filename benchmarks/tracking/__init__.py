"""The work-precision report of the trackers: what runs, how it is measured, what is written."""
