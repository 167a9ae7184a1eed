"""Owns the chapters on the hopper of Uyanik et al. 2015: `ltp.reproduce.hopper` puts them in order."""
