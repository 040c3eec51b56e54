"""The tests of the operator panel, by what they show; tests/e2e/test_panel.py runs them."""
