!> What the summary says of the friction of joints.
module friction_words
  use kinds, only: wp
  use readable_text, only: json_text
  use scene_run, only: run_state
  use summary_text, only: summary_record
  implicit none (type, external)
  private
  public :: friction_lines

contains

  !> A line for each joint with friction.
  subroutine friction_lines(run, text)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    integer :: i
    if (.not. allocated(run%sys%friction)) return
    if (size(run%sys%friction) == 0) return
    call text%open('friction', '[')
    do i = 1, size(run%sys%friction)
      call one_joint(run, i, text)
    end do
    call text%close()
  end subroutine friction_lines

  !> One joint: how far it slid, what that took, how long it was at rest.
  subroutine one_joint(run, i, text)
    type(run_state), intent(in) :: run
    integer, intent(in) :: i                   !! its number among those with friction
    type(summary_record), intent(inout) :: text
    real(wp) :: lost                           ! [J]
    real(wp) :: slid                           ! [m] or [rad]
    associate (m => run%sys%m, x => run%sys%friction(i))
      associate (row => m%s%constraints(m%s%permanent + i)%item)
        lost = run%y(2*m%s%nq + m%s%nz + m%s%nzd + 2 + row%switch_number)
        slid = x%slid + abs(run%sys%place_of(i) - x%place)
        call text%open('', '{')
        call text%member('name', json_text(trim(row%name)))
        call text%figure('  friction of joint "'//trim(row%name)//'": slid ', 'slid', slid, 4)
        call text%figure(trim(merge(' rad', ' m  ', row%angular))//', lost ', 'lost', lost, 4)
        call text%figure(' J; times that it came to rest ', 'sticks', x%sticks)
        call text%figure(', broke away ', 'slips', x%slips)
        call text%figure(', turned without rest ', 'turns', x%turns)
        call text%figure('; at rest ', 'time_at_rest', x%rest, 4)
        if (x%rest > 0.0_wp) then
          call text%figure(' s, with at most ', 'largest_share', x%share, 4, rest=' of its limit')
        else
          call text%line(' s')
        end if
        if (x%unknown > 0.0_wp) then
          call text%figure('    its share of the load is not determined by rigid bodies, as others hold the same motion, during ', &
                           'undetermined', x%unknown, 4, rest=' s')
        end if
        call text%close()
      end associate
    end associate
  end subroutine one_joint
end module friction_words
