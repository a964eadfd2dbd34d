"""Public recordings of other machines: fetched, converted, searched, and the answers judged."""
