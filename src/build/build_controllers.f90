!> Controllers of the model from their records.
module build_controllers
  use build_history, only: make_history
  use build_markers, only: marker_table
  use build_quantities, only: make_quantity
  use deck_records, only: deck
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: make_controllers, place_controllers

contains

  !> Their laws; `place_controllers` adds what they sense.
  subroutine make_controllers(d, s)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    integer :: k
    allocate (s%controllers(size(d%controllers)))
    do k = 1, size(s%controllers)
      associate (c => s%controllers(k), r => d%controllers(k))
        c%name = r%name
        c%kp = r%kp
        c%ki = r%ki
        c%kd = r%kd
        c%filter = r%filter
        c%lower = r%lower
        c%upper = r%upper
        c%windup_time = r%windup_time
        c%sample = r%sample
        c%delay = r%delay
        call make_history(d, r%history, c%reference)
        call c%set_up()
      end associate
    end do
  end subroutine make_controllers

  !> The quantities that they sense, between markers of the scene. A force with a controller watches the same quantity.
  subroutine place_controllers(d, s, markers)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s              !! its bodies are set up
    type(marker_table), intent(inout) :: markers
    integer :: k
    do k = 1, size(s%controllers)
      associate (column => d%controllers(k)%argument)
        call make_quantity(d, s, d%sensors(column%sensor), column%number, markers, s%controllers(k)%quantity)
      end associate
    end do
    do k = 1, size(d%forces)
      associate (f => s%forces(s%springs + k)%item)
        if (f%controller == 0) cycle
        f%motions = 1
        allocate (f%arguments(1))
        allocate (f%arguments(1)%item, source=s%controllers(f%controller)%quantity)
      end associate
    end do
  end subroutine place_controllers
end module build_controllers
