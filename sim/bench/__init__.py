"""The benches: what `odm bench` measures, and what it is measured against."""
