!> Quantities of motion of the model from the sensors of the deck that show them: the factory of their kinds.
module build_quantities
  use build_markers, only: elastic_marker, find_marker, marker_table
  use deck_records, only: deck, marker_record, sensor_record
  use quantity, only: difference_quantity, distance_quantity, elastic_quantity, quantity_model
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: make_quantity

contains

  !> The quantity that a column of a sensor shows, between markers that are added where they are new.
  subroutine make_quantity(d, s, r, column, markers, item)
    type(deck), intent(in) :: d
    type(scene), intent(in) :: s              !! its bodies are set up
    type(sensor_record), intent(in) :: r
    integer, intent(in) :: column             !! among its columns of motion (`deck_columns`)
    type(marker_table), intent(inout) :: markers
    class(quantity_model), allocatable, intent(out) :: item
    type(marker_record) :: a, b               ! b: the ground's origin, where nothing else is named
    a = r%marker
    b = r%other
    select case (r%quantity)
    case ('position', 'velocity')
      item = difference_quantity(component=column)
    case ('angle', 'angular_velocity')
      item = difference_quantity(component=3, angular=.true.)
    case ('deflection', 'coordinate')
      allocate (elastic_quantity :: item)
      b = marker_record(body=a%body)
    case ('spring')
      a = d%springs(r%spring)%a
      b = d%springs(r%spring)%b
      if (d%springs(r%spring)%type == 'torsional') then
        item = difference_quantity(component=3, angular=.true.)
      else
        allocate (distance_quantity :: item)
      end if
      item%datum = d%springs(r%spring)%free
      item%pending = .not. d%springs(r%spring)%has_free
    case default
      allocate (distance_quantity :: item)
    end select
    item%rate = any(r%quantity == [character(20) :: 'velocity', 'angular_velocity']) .or. &
                (r%quantity == 'coordinate' .and. column == 2)
    if (r%quantity == 'coordinate') then
      item%ia = elastic_marker(s, markers, a%body, 0, r%index)
    else if (r%quantity == 'deflection') then
      item%ia = elastic_marker(s, markers, a%body, a%node, column)
    else
      item%ia = find_marker(s, markers, a)
    end if
    item%ib = find_marker(s, markers, b)
  end subroutine make_quantity
end module build_quantities
