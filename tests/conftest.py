from locomotion.rendering.graphics import choose_graphics

choose_graphics()  # before MuJoCo is imported

import torch

# As training does: on two cores a second thread for networks this small costs time.
torch.set_num_threads(1)
