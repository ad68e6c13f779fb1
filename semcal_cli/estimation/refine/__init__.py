"""The refinement of a pose by gradient ascent on mutual information (Alg. 1), and its polish."""
