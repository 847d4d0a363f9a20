"""The network and everything up to the seam: torch lives here."""
