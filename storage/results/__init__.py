"""The store of stage results: fingerprints, manifests, digests of code, and adoption."""
