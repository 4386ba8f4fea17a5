"""Robot arm that moves two arrays of whiskers past free-standing objects on a table."""
