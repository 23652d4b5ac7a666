"""Classes of views, by growing neural gas: which place a scan or an image may be of."""
