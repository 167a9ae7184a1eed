"""The sections of the report, one file each: a title, a figure and a sentence."""
