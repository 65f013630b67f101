!> Lines of the summary about the energy that friction of joints, terms of materials and damped springs dissipated.
module loss_words
  use kinds, only: wp
  use readable_text, only: json_text
  use scene_model, only: scene
  use scene_run, only: run_state
  use summary_text, only: summary_record
  use text, only: either, to_text
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: friction_lines, loss_lines

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

  !> One joint: how far it slid, the energy lost, how long it was at rest.
  subroutine one_joint(run, i, text)
    type(run_state), intent(in) :: run
    integer, intent(in) :: i                   !! its number among those with friction
    type(summary_record), intent(inout) :: text
    real(wp) :: lost                           ! [J]
    real(wp) :: slid                           ! [m] or [rad]
    associate (m => run%sys%m, x => run%sys%friction(i))
      associate (row => m%s%constraints(m%s%permanent + i)%item)
        lost = run%y(2*m%s%nq + m%s%nz + m%s%nzd + 2 + row%switch_number)
        slid = x%slid + abs(run%sys%position_of(i) - x%position)
        call text%open('', '{')
        call text%member('name', json_text(trim(row%name)))
        call text%figure('  friction of joint "'//trim(row%name)//'": slid ', 'slid', slid, 4)
        call text%figure(either(' rad', ' m', row%angular)//', lost ', 'lost', lost, 4)
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

  !> A line for each material, with all its terms, and for each damped spring.
  subroutine loss_lines(run, text)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    real(wp) :: lost                           ! [J]
    integer :: i
    logical :: last                            ! term of a material
    associate (s => run%sys%m%s)
      if (size(s%losses) == 0) return
      call text%open('losses', '[')
      do i = 1, size(s%losses)
        associate (cause => s%losses(i))
          lost = run%y(s%ny - size(s%integrated) - size(s%losses) + i)
          call text%open('', '{')
          if (cause%spring > 0) then
            call text%member('spring', json_text(trim(s%forces(cause%spring)%item%name)))
            call text%figure('  lost in spring "'//trim(s%forces(cause%spring)%item%name)//'":', 'lost', lost, 4)
          else
            call one_term(trim(s%materials(cause%material)), law_of(s, cause%material), cause%term, lost, text)
          end if
          call text%close()
          last = i >= s%term_losses
          if (.not. last) last = s%losses(i + 1)%term == 1
          if (last) call text%line(' J')
        end associate
      end do
      call text%close()
    end associate
  end subroutine loss_lines

  !> One term of a material, in a line with the others.
  subroutine one_term(material, law, k, lost, text)
    character(*), intent(in) :: material
    type(viscoelastic_terms), intent(in) :: law
    integer, intent(in) :: k                   !! its number in the law, and in words among those of its kind
    real(wp), intent(in) :: lost               !! [J]
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: words
    integer :: number
    number = merge(k, k - law%second, k <= law%second)
    call text%member('material', json_text(material))
    call text%member('kind', json_text(trim(law%words(k))))
    call text%member('term', to_text(number))
    words = trim(law%words(k))//' term '//to_text(number)
    if (k == 1) then
      words = '  lost in material "'//material//'": '//words
    else
      words = ' J, '//words
    end if
    call text%figure(words, 'lost', lost, 4)
  end subroutine one_term

  !> The law of a material that a body has.
  pure type(viscoelastic_terms) function law_of(s, material) result(law)
    type(scene), intent(in) :: s
    integer, intent(in) :: material
    integer :: b, r
    do b = 1, size(s%bodies)
      do r = 1, size(s%bodies(b)%segments)
        if (s%bodies(b)%segments(r)%material == material) law = s%bodies(b)%segments(r)%law
      end do
    end do
  end function law_of
end module loss_words
