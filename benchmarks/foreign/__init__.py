"""Records of a friction simulator that shares nothing with the project's own, and the search judged on them."""
