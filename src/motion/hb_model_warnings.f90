!> Warnings about a model that can be solved, before it is: tones with a common period, no load.
module hb_model_warnings
   use hb_error_estimate, only: near_commensurate
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_text, only: join, string_t, to_text
   use hb_tones, only: tones_t
   implicit none
   private
   public :: commensurate_text, describe_warnings, has_no_load, no_load_text

   integer, parameter :: max_text = 1000                              ! length of a warning
   real(wp), parameter :: rounding = 1.0e-12_wp                       ! of a frequency that is zero
   character(*), parameter :: no_load_text = "no load acts and no tone is unknown: only laws can cause a motion"

contains

   !> Lists the warnings about a model, one per line; none: an empty text.
   subroutine describe_warnings(model, text)
      type(model_t), intent(in) :: model
      character(:), allocatable, intent(out) :: text

      text = trim(commensurate_text(model%tones, model%error_estimate%commensurability))
      if (.not. has_no_load(model)) return
      if (len(text) > 0) text = text//new_line("a")
      text = text//no_load_text
   end subroutine describe_warnings

   !> Whether nothing drives the model: no load, no law that depends on tones, and no unknown tone of a self-excited
   !> motion.
   pure logical function has_no_load(model)
      type(model_t), intent(in) :: model
      integer :: i

      has_no_load = .not. any(model%tones%is_unknown) .and. model%loads%is_zero() .and. &
                    .not. any([(allocated(model%laws(i)%law%modulation), i=1, size(model%laws))])
   end function has_no_load

   !> Names a combination of given tones with a frequency below `limit` times the largest, and the equivalent model
   !> with fewer tones if it is zero; empty if there is none.
   function commensurate_text(tones, limit) result(text)
      type(tones_t), intent(in) :: tones
      real(wp), intent(in) :: limit                                   !! relative to the largest tone
      character(max_text) :: text
      integer, allocatable :: k(:)
      real(wp) :: frequency

      text = ""
      if (tones%n_tones < 2 .or. any(tones%is_unknown)) return
      call near_commensurate(tones, k, frequency)
      if (frequency > max(limit, rounding)*maxval(tones%omega)) return
      k = k/common_divisor(k)
      frequency = abs(dot_product(k, tones%omega))
      text = "tones "//trim(list_of(tones%in_unit(tones%omega)))//" "//trim(tones%unit())//": their combination "// &
             trim(tuple_text(k))//" has the frequency "
      if (frequency > rounding*maxval(tones%omega)) then
         text = trim(text)//" "//to_text(tones%in_unit(frequency))//" "//trim(tones%unit())//"; such tones are nearly commensurate"
      else
         text = trim(text)//" 0; "//model_of_fewer(tones, k)
      end if
   end function commensurate_text

   !> The model of fewer tones with the same loads, for k.omega = 0.
   function model_of_fewer(tones, k) result(text)
      type(tones_t), intent(in) :: tones
      integer, intent(in) :: k(:)
      character(max_text) :: text
      integer, allocatable :: in_it(:)
      integer :: i, m

      in_it = pack([(i, i=1, size(k))], k /= 0)
      m = findloc(abs(k(in_it)), 1, dim=1, back=.true.)
      if (size(in_it) == 2) then
         associate (a => in_it(1), b => in_it(2))
            text = "use one tone of "//to_text(rounded(tones%in_unit(tones%omega(a)/abs(k(b)))))//" "//trim(tones%unit())// &
               " instead of both, with tuple "//to_text(abs(k(b)))//" for loads of tone "//to_text(a)//" and "// &
               to_text(abs(k(a)))//" for those of tone "//to_text(b)
         end associate
      else if (m > 0) then
         m = in_it(m)
         text = "leave out tone "//to_text(m)//", and give its loads the tuple "// &
            trim(tuple_text(-k(m)*pack(k, [(i /= m, i=1, size(k))])))//" of the others"
      else
         text = "fewer tones, of which these are integer combinations, give the same motion"
      end if
   end function model_of_fewer

   !> A number without the rounding errors of its last digits.
   real(wp) function rounded(number)
      real(wp), intent(in) :: number
      character(24) :: digits

      write (digits, "(es19.11)") number
      read (digits, *) rounded
   end function rounded

   pure integer function common_divisor(k)
      integer, intent(in) :: k(:)

      do common_divisor = maxval(abs(k)), 2, -1
         if (all(modulo(k, common_divisor) == 0)) return
      end do
      common_divisor = 1
   end function common_divisor

   function tuple_text(k) result(text)
      integer, intent(in) :: k(:)
      character(13*size(k) + 2) :: text
      type(string_t) :: words(size(k))
      integer :: i

      do i = 1, size(k)
         words(i)%value = to_text(k(i))
      end do
      text = "("//join(words, ", ")//")"
   end function tuple_text

   function list_of(omega) result(text)
      real(wp), intent(in) :: omega(:)
      character(30*size(omega) + 5) :: text
      type(string_t) :: words(size(omega))
      integer :: i

      do i = 1, size(omega)
         words(i)%value = to_text(omega(i))
      end do
      text = join(words(:size(omega) - 1), ", ")//" and "//words(size(omega))%value
   end function list_of
end module hb_model_warnings
