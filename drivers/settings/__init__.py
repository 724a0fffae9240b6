"""Which keys do the tables [laser], [encoders] and [simulation] have? One file for each table."""
