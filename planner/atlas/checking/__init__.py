"""Checks maps by code that shares nothing with the searches that computed them."""
