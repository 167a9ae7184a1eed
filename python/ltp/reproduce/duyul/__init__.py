"""Owns the chapters on the cart-pendulum of Duyul 2018: `ltp.reproduce.cart_pendulum` puts them in order."""
