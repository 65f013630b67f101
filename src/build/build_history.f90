!> Histories of the model from their records.
module build_history
  use kinds, only: pi
  use deck_records, only: history_record
  use history, only: history_function, fit_table, kind_polynomial, kind_sine, kind_ramp, kind_cycloid, kind_table, &
                     kind_pulse
  implicit none (type, external)
  private
  public :: make_history

contains

  !> A history of the model from its record.
  subroutine make_history(r, h)
    type(history_record), intent(in) :: r
    type(history_function), intent(out) :: h
    h%name = r%name
    h%start = r%start
    h%finish = r%finish
    h%v0 = r%start_value
    h%v1 = r%end_value
    select case (r%kind)
    case ('polynomial')
      h%kind = kind_polynomial
      h%c = r%coefficients
    case ('sine')
      h%kind = kind_sine
      h%offset = r%offset
      h%amplitude = r%amplitude
      h%omega = 2*pi*r%frequency
      h%phase = r%phase
    case ('ramp')
      h%kind = kind_ramp
    case ('cycloid')
      h%kind = kind_cycloid
    case ('table')
      h%kind = kind_table
      h%t = r%time
      h%y = r%values
      call fit_table(h)
    case default
      h%kind = kind_pulse
      h%v1 = r%value
    end select
  end subroutine make_history
end module build_history
