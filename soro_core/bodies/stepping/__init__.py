"""Kernels of a world: contacts, impulses, and steps in time of arms and bodies together."""
