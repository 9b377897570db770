"""What a recording of a tool in contact says: the kind of contact, where it is, and what was never tried."""
