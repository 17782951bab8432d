import torch

# As training does: on two cores a second thread for networks this small costs time.
torch.set_num_threads(1)
