"""The shared solver core: gauge, start, linear system, factorization, step policies, termination, diagnosis."""
