"""Which keys does the table [slam] have? One file for each table below it; begin at slam.py."""
